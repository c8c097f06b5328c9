# SPDX-License-Identifier: Apache-2.0
"""Mountings that a recording contains: transforms on /tf_static or /tf of a bag, poses in the lines of a log."""
import math

import numpy as np
import pytest
from bags import SECOND, laser_scan, needs_rosbags, write_bag

from dbscan_reg_ros.core.geometry.mounting import MountingError
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.recordings.poses import compose

LASER, PLATE = SE2(0.3, -0.2, math.radians(45.0)), SE2(0.1, 0.0, 0.0)


def transforms(stamp, *edges):
    """A message with the transforms (parent, frame, pose)."""
    from rosbags.typesys import Stores, get_typestore
    types = get_typestore(Stores.ROS2_JAZZY).types
    made = []
    for parent, frame, pose in edges:
        time = types['builtin_interfaces/msg/Time'](sec=stamp // SECOND, nanosec=stamp % SECOND)
        rotation = {'x': 0.0, 'y': 0.0, 'z': math.sin(0.5 * pose.theta), 'w': math.cos(0.5 * pose.theta)}
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
@pytest.mark.parametrize('slash', ['', '/'], ids=['', 'slash'])
@pytest.mark.parametrize('static', [('base_link', 'plate', PLATE), None], ids=['part', 'none'])
def test_a_mounting_may_be_on_tf_as_in_recordings_without_tf_static(tmp_path, static, slash):
    edges = [('base_link', 'plate', PLATE), ('plate', 'front', PLATE.inverse() @ LASER)][1 if static else 0:]
    edges = [(slash + parent, slash + frame, pose) for parent, frame, pose in edges]
    messages = [moving(k, *edges) for k in range(5)]
    if static:
        messages.insert(0, ('/tf_static', transforms(SECOND, static)))
    found = bag_of(tmp_path / 'bag', messages).mounting_on('base_link')
    assert np.allclose(found.pose.as_array(), LASER.as_array()) and not found.upside_down


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
