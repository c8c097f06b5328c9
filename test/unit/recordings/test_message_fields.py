# SPDX-License-Identifier: Apache-2.0
"""Messages made without ROS are those that ROS makes."""
import numpy as np
import pytest
import rclpy.serialization
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry as OdometryMessage

from dbscan_reg_ros import Odometry
from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.node.interfaces.messages import filled, scan_to_message, segments_to_message
from dbscan_reg_ros.recordings.bags.messages import MessageMaker
from dbscan_reg_ros.recordings.message_fields import odometry_fields, scan_fields, segments_fields, transform_fields
from dbscan_reg_ros.robot.base_state import base_state
from dbscan_reg_ros.simulation import demo


@pytest.fixture(scope='module')
def updates():
    odometry = Odometry()
    return [odometry.process(scan) for scan in demo().scans[:40:8]]


def test_a_message_is_the_same_with_and_without_ros(updates):
    maker, mounting = MessageMaker(), Mounting()
    odometry_message, transform_message = OdometryMessage(), TransformStamped()
    for update in updates:
        state, scan = base_state(update, mounting.pose, mounting.pose), update.features.scan
        pose_fields, place = (fields(state, 'odom', 'base') for fields in (odometry_fields, transform_fields))
        for kind, fields, message in (
                ('sensor_msgs/msg/LaserScan', scan_fields(scan), scan_to_message(scan)),
                ('nav_msgs/msg/Odometry', pose_fields, filled(odometry_message, pose_fields)),
                ('geometry_msgs/msg/TransformStamped', place, filled(transform_message, place)),
                ('visualization_msgs/msg/MarkerArray', segments_fields(update, mounting.pose, 'odom'),
                 segments_to_message(update, mounting.pose, 'odom'))):
            with_ros = maker.store.deserialize_cdr(rclpy.serialization.serialize_message(message), kind)
            assert maker.serialize(kind, fields) == maker.store.serialize_cdr(with_ros, kind), kind


def test_fields_that_are_not_named_have_the_defaults_of_their_type():
    maker = MessageMaker()
    message = maker.store.deserialize_cdr(maker.serialize('sensor_msgs/msg/Imu', {'header': {'frame_id': 'imu'}}),
                                          'sensor_msgs/msg/Imu')
    assert message.header.frame_id == 'imu' and message.orientation.w == 1.0 and message.orientation.x == 0.0
    assert np.array_equal(message.angular_velocity_covariance, np.zeros(9))


@pytest.mark.parametrize('seed', [1, 2, 3])
def test_messages_of_every_type_are_read_and_written_by_rosbags(seed):
    maker, random = MessageMaker(), np.random.default_rng(seed)
    for kind in maker.store.fielddefs:
        raw = maker.serialize(kind, some_fields(maker.store, kind, random))
        assert maker.store.serialize_cdr(maker.store.deserialize_cdr(raw, kind), kind) == raw, kind


def test_values_of_messages_are_those_given():
    maker = MessageMaker()
    kind, fields = 'sensor_msgs/msg/JointState', {'name': ['a', 'left wheel'], 'velocity': np.array([1.5, -2.0])}
    message = maker.store.deserialize_cdr(maker.serialize(kind, fields), kind)
    assert message.name == fields['name'] and message.velocity.tolist() == [1.5, -2.0] and not len(message.effort)
    with pytest.raises(TypeError, match='has no field names'):
        maker.serialize(kind, {'names': []})
    with pytest.raises(ValueError, match='covariance: 35 values where 36 are needed'):
        maker.serialize('geometry_msgs/msg/PoseWithCovariance', {'covariance': np.zeros(35)})


def some_fields(store, kind, random):
    """Return random fields of a message of type `kind`, about two in three of them."""
    return {name: some_value(store, field, random) for name, field in store.fielddefs[kind][1] if random.random() < 0.7}


def some_value(store, field, random):
    node, detail = field
    if node.name == 'NAME':
        return some_fields(store, detail, random)
    if node.name == 'BASE':
        return 'x' * random.integers(9) if detail[0] == 'string' else int(random.integers(2))
    element, length = detail
    count = length if node.name == 'ARRAY' else random.integers(4)
    return [some_value(store, element, random) for _ in range(count)]
