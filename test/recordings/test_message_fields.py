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
from dbscan_reg_ros.recordings.bags.with_rosbags import MessageMaker
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


def test_rosbags_reads_and_writes_the_bytes_of_an_empty_message_of_each_type():
    maker = MessageMaker()
    for kind in maker.store.fielddefs:
        raw = maker.serialize(kind, {})
        assert bytes(maker.store.serialize_cdr(maker.store.deserialize_cdr(raw, kind), kind)) == raw, kind


def test_fields_that_are_not_named_have_the_defaults_of_their_type():
    maker = MessageMaker()
    message = maker.store.deserialize_cdr(maker.serialize('sensor_msgs/msg/Imu', {'header': {'frame_id': 'imu'}}),
                                          'sensor_msgs/msg/Imu')
    assert message.header.frame_id == 'imu' and message.orientation.w == 1.0 and message.orientation.x == 0.0
    assert np.array_equal(message.angular_velocity_covariance, np.zeros(9))
