# SPDX-License-Identifier: Apache-2.0
"""Mountings that a recording contains: transforms on /tf_static or /tf of a bag, poses in the lines of a log."""
import math

import numpy as np
import pytest
from bags import SECOND, laser_scan, needs_rosbags, write_bag

from dbscan_reg_ros.core.geometry.mounting import MountingError
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.recordings.playback import ODOMETRY
from dbscan_reg_ros.recordings.poses import compose

LASER, PLATE = SE2(0.3, -0.2, math.radians(45.0)), SE2(0.1, 0.0, 0.0)


def transforms(stamp, *edges, w=None):
    """A message with the transforms (parent, frame, pose); `w` replaces the last value of their quaternions."""
    from rosbags.typesys import Stores, get_typestore
    types = get_typestore(Stores.ROS2_JAZZY).types
    made = []
    for parent, frame, pose in edges:
        time = types['builtin_interfaces/msg/Time'](sec=stamp // SECOND, nanosec=stamp % SECOND)
        rotation = {'x': 0.0, 'y': 0.0, 'z': math.sin(0.5 * pose.theta),
                    'w': math.cos(0.5 * pose.theta) if w is None else w}
        made.append(types['geometry_msgs/msg/TransformStamped'](
            header=types['std_msgs/msg/Header'](stamp=time, frame_id=parent), child_frame_id=frame,
            transform=types['geometry_msgs/msg/Transform'](
                translation=types['geometry_msgs/msg/Vector3'](x=pose.x, y=pose.y, z=0.2),
                rotation=types['geometry_msgs/msg/Quaternion'](**rotation))))
    return types['tf2_msgs/msg/TFMessage'](transforms=made)


def bag_of(path, messages):
    """Open a bag of a scan in the frame `front`, and these transforms (topic, message)."""
    return open_recording(write_bag(path, [
        ('/scan', SECOND, laser_scan()), *((topic, (1 + k) * SECOND, each) for k, (topic, each) in
                                           enumerate(messages))]))


def moving(k, *edges):
    """Transforms on /tf: the base drives, the `edges` stay."""
    return '/tf', transforms((1 + k) * SECOND, ('odom', 'base_link', SE2(0.2 * k, 0.0, 0.1 * k)), *edges)


@needs_rosbags
@pytest.mark.parametrize(('static', 'slash'), [(('base_link', 'plate', PLATE), ''), (None, '/')], ids=['part', 'none'])
def test_a_mounting_may_be_on_tf_as_in_recordings_without_tf_static(tmp_path, static, slash):
    edges = [('base_link', 'plate', PLATE), ('plate', 'front', PLATE.inverse() @ LASER)][1 if static else 0:]
    edges = [(slash + parent, slash + frame, pose) for parent, frame, pose in edges]
    messages = [moving(k, *edges) for k in range(5)]
    if static:
        messages.insert(0, ('/tf_static', transforms(SECOND, static)))
    found = bag_of(tmp_path / 'bag', messages).mounting_on('base_link')
    assert np.allclose(found.pose.as_array(), LASER.as_array()) and not found.upside_down


@needs_rosbags
@pytest.mark.parametrize('tilt', [0.0, 0.1])
def test_a_lidar_that_hangs_upside_down_is_known_by_its_transform(tmp_path, tilt):
    """It is rotated about its x axis, by half a turn and the `tilt` [rad], and then by the yaw."""
    message = transforms(SECOND, ('base_link', 'front', LASER))
    half, roll = 0.5 * LASER.theta, 0.5 * (math.pi + tilt)
    rotation = message.transforms[0].transform.rotation
    rotation.x, rotation.y = math.cos(half) * math.sin(roll), math.sin(half) * math.sin(roll)
    rotation.z, rotation.w = math.sin(half) * math.cos(roll), math.cos(half) * math.cos(roll)
    found = bag_of(tmp_path / 'bag', [('/tf_static', message)]).mounting_on('base_link')
    assert found.pose.as_array() == pytest.approx(LASER.as_array()) and found.upside_down


@needs_rosbags
def test_a_frame_that_moves_on_tf_is_no_mounting(tmp_path):
    bag = bag_of(tmp_path / 'bag', [moving(k, ('base_link', 'front', SE2(theta=0.1 * k))) for k in range(5)])
    with pytest.raises(MountingError, match=r'none that is constant on /tf$'):
        bag.mounting_on('base_link')


@needs_rosbags
def test_the_frames_above_the_lidar_are_named_where_the_base_frame_is_not_among_them(tmp_path):
    bag = bag_of(tmp_path / 'bag', [('/tf_static', transforms(SECOND, ('base_footprint', 'plate', PLATE),
                                                              ('plate', 'front', LASER)))])
    with pytest.raises(MountingError, match=r'base_frame may be one of the frames above it: plate, base_footprint$'):
        bag.mounting_on('base_link')
    assert bag.mounting_on('base_footprint').pose.x == pytest.approx(PLATE.x + LASER.x)


@needs_rosbags
@pytest.mark.parametrize(('messages', 'says'), [
    ([transforms(SECOND, ('base_link', 'front', SE2()), w=0.0)], r'\(0, 0, 0, 0\)'),
    ([transforms(SECOND, ('base_link', 'front', pose)) for pose in (PLATE, LASER)], 'two robots'),
], ids=['no_rotation', 'two_values'])
def test_a_transform_that_is_no_pose_or_has_two_values_is_no_mounting(tmp_path, messages, says):
    bag = bag_of(tmp_path / 'bag', [('/tf_static', message) for message in messages])
    with pytest.raises(MountingError, match=says):
        bag.mounting_on('base_link')


@needs_rosbags
def test_a_robot_never_gets_the_mounting_or_the_wheels_of_another(tmp_path):
    of_a = transforms(SECOND, ('base_link', 'front', LASER))
    bag = write_bag(tmp_path / 'bag', [('/a/scan', SECOND, laser_scan()), ('/b/scan', SECOND, laser_scan()),
                                       ('/a/tf_static', SECOND, of_a), ('/a/odom', SECOND, odometry(SECOND))])
    a, b = (open_recording(bag, f'/{name}/scan') for name in 'ab')
    assert a.mounting_on('base_link').pose.x == pytest.approx(LASER.x) and a.wheel_odometry() is not None
    with pytest.raises(MountingError, match='no transform'):
        b.mounting_on('base_link')
    assert b.wheel_odometry() is None and [channel.input for channel in b.channels()] == ['', '', '']


@needs_rosbags
def test_poses_with_a_quaternion_that_is_no_rotation_are_not_used_and_said_with_it(tmp_path):
    messages = [('/odom', odometry(k * SECOND, w)) for k, w in enumerate((1.0, 0.0, math.nan, 1.01), 1)]
    bag = bag_of(tmp_path / 'bag', messages)
    assert bag.wheel_odometry()[0].tolist() == [SECOND, 4 * SECOND]
    assert '2 of 4 poses on /odom' in bag.problems[0] and '(0, 0, 0, 0)' in bag.problems[0]


@needs_rosbags
def test_the_pose_of_the_wheels_at_a_scan_is_interpolated_and_held_beyond_their_time(tmp_path):
    rows = [('/scan', 2, laser_scan(2 * SECOND)), ('/scan', 4, laser_scan(4 * SECOND)),
            *(('/odom', k, odometry(k * SECOND, x=float(k))) for k in (1, 3))]
    bag = open_recording(write_bag(tmp_path / 'bag', rows))
    assert [record.robot_pose[0] for record in bag.records()] == [2.0, 3.0]


def odometry(stamp, w=1.0, x=0.0):
    """A message of wheel odometry at (x, 0) with the quaternion (0, 0, 0, w)."""
    from dbscan_reg_ros.recordings.bags.with_rosbags import MessageMaker
    from dbscan_reg_ros.recordings.message_fields import header_fields
    maker = MessageMaker()
    pose = {'position': {'x': x}, 'orientation': {'w': w}}
    return maker.store.deserialize_cdr(maker.serialize(ODOMETRY, {
        'header': header_fields(stamp, 'odom'), 'pose': {'pose': pose}}), ODOMETRY)


def log_of(path, laser, robot, kind='RLASER'):
    """Open a log with these poses of laser and robot."""
    def words(pose):
        return ' '.join(f'{value:.6f}' for value in pose)
    path.write_text('\n'.join(f'{kind} 3 1.0 2.0 1.5 {words(a)} {words(b)} {k}.1 host {k}.1'
                              for k, (a, b) in enumerate(zip(laser, robot, strict=True))))
    return open_recording(path, kind)


def test_the_mounting_in_a_log_is_the_constant_offset_of_the_laser(tmp_path):
    robot = np.array([(0.3 * k, 0.02 * k * k, 0.1 * k) for k in range(8)])
    rear = SE2(-0.25, 0.0, math.pi)
    found = log_of(tmp_path / 'a.log', compose(robot, rear.as_array()[None]), robot).mounting_on('base_link').pose
    assert np.allclose(found.apply(np.eye(2)), rear.apply(np.eye(2)), atol=1e-5)
    # Both poses are equal, or those of the laser were corrected.
    for laser in (robot, compose(robot, np.random.default_rng(1).normal(0.0, 0.05, (8, 3)))):
        with pytest.raises(MountingError, match='no poses of the laser with a constant offset'):
            log_of(tmp_path / 'b.log', laser, robot).mounting_on('base_link')
