# SPDX-License-Identifier: Apache-2.0
"""Frames in the node: where its lasers sit, as transforms say, and when it listens to those of others; without DDS."""
import dataclasses

import pytest
import rclpy  # noqa: F401 - needs ROS
from core_stand_in import StandIn, endpoint
from ros_helpers import distances, of_base, transform
from two_lidars import drive_of_two_lidars

from dbscan_reg_ros import SE2, ParameterError
from dbscan_reg_ros.node.frames.mountings import Mountings
from dbscan_reg_ros.node.frames.transforms import describe_missing
from dbscan_reg_ros.node.priors import Priors
from dbscan_reg_ros.robot.parameters import NodeParameters


@pytest.mark.parametrize('parents, text', [
    ({'laser': 'base_footprint', 'base_footprint': 'odom'}, "set base_frame to 'base_footprint'"),
    ({'laser': 'chassis', 'arm': 'chassis'}, "set base_frame to 'chassis'"),
    ({'base_link': 'odom', 'base_scan': 'base_link', 'laser_frame': 'base_link'}, "let the driver send 'laser_frame'"),
    ({'base_link': 'odom', 'laser': 'mast'}, "no transform connects 'mast', to which 'laser' belongs"),
    ({'wheel': 'axle'}, "base_frame 'base_link' is none of them"),
])
def test_frames_that_are_there_are_named_in_place_of_a_missing_one(parents, text):
    said = describe_missing(None, 'base_link', 'laser', parents)
    assert text in said and all(repr(frame) in said for frame in (*parents, *parents.values()))


def test_who_publishes_transforms_where_is_named_if_none_is_received(tf_type):
    node = StandIn()

    def said():
        return describe_missing(node, 'base_link', 'laser', {})

    assert said() == 'no other node publishes on /tf or /tf_static'
    node.others['/robot/tf_static'] = [endpoint('/robot/state', tf_type)]
    assert said() == ('transforms are published on /robot/tf_static, not on /tf or /tf_static: start the node with '
                      '-r /tf_static:=/robot/tf_static')
    node.others['/tf_static'] = [endpoint('/state', tf_type)]
    assert said() == 'none is received from /state yet'
    assert 'header.frame_id is empty' in describe_missing(node, 'base_link', '', {})


@pytest.mark.parametrize('values, make', [
    ({'mounting': 'tf'}, lambda p: Mountings('base_link', p.lidar('scan'), None)),
    ({'prior.source': 'tf'}, lambda p: Priors(StandIn(), p, None, None, None))])
def test_without_tf2_msgs_what_needs_transforms_is_refused(values, make):
    [(name, value)] = values.items()
    with pytest.raises(ParameterError, match=f'^{name} = {value!r}: needs tf2_msgs, which is not installed'):
        make(NodeParameters().replace(values))


def test_frames_with_a_prefix_are_named_in_place_of_those_that_are_asked_for(start_core, scans, tf_type):
    robot = start_core(mounting='tf')
    robot.receive('/tf_static', tf_type(transforms=[transform('robot/base_link', f'robot/{name}')
                                                    for name in ('laser', 'imu')]))
    assert robot.play(scans[:1]) == [None]
    assert "scan skipped: no transform from 'base_link' to 'laser' on /tf or /tf_static" in robot.log
    assert "set base_frame to 'robot/base_link'" in robot.log and "let the driver send 'robot/laser'" in robot.log


def test_a_mounting_that_is_sent_again_keeps_the_pose_and_is_named(start_core, scans, truth, tf_type):
    robot = start_core(mounting='tf')
    old, new = SE2(0.3), SE2(0.2, 0.1, 0.8)
    robot.receive('/tf_static', tf_type(transforms=[transform('base_link', 'laser', old)]))
    first = robot.play(scans[:20])
    robot.receive('/tf_static', tf_type(transforms=[transform('base_link', 'laser', new)]))
    second = robot.play(scans[20:40])
    before = of_base(truth[:20], old)
    after = [before[-1] @ new @ truth[19].inverse() @ pose @ new.inverse() for pose in truth[20:40]]
    assert distances(first + second, before + after).max() < 0.1
    said = ("the transform from 'base_link' to 'laser' was sent again with other values: x 0.300 m, y 0.000 m, "
            'yaw 0.0 deg became x 0.200 m, y 0.100 m, yaw 45.8 deg')
    assert robot.log.count(said) == 1 and said in robot.diagnosis().message
    for unwanted in 'max_', 'could not be registered', 'not known at the time':
        assert unwanted not in robot.log


def listens(robot):
    return any(each.topic_name == '/tf' for each in robot.node.subscriptions)


def test_tf_is_subscribed_to_only_while_we_and_others_publish_it(start_core, scans, tf_type):
    robot = start_core()
    robot.play(scans[:3])
    robot.node.wait(1.0)
    assert len(robot.sent('/tf')) == 3 and not listens(robot)
    robot.node.others['/tf'] = [endpoint('/arm', tf_type)]
    for value in True, False, True:
        robot.set(publish_tf=value)
        robot.node.wait(1.0)
        assert listens(robot) == value
    # Our own transforms, which come back, are not those of another node.
    assert all(robot.play(scans[3:6]))
    assert len(robot.sent('/tf')) == 3 and 'another node' not in robot.diagnosis().message
    robot.node.others.clear()
    robot.node.wait(1.0)
    assert not listens(robot)
    assert [each.topic_name for each in robot.node.subscriptions].count('/tf_static') == 1


def test_tf_is_not_subscribed_to_if_no_transform_is_sent_or_read(start_core, tf_type):
    robot = start_core(publish_tf=False)
    robot.node.others['/tf'] = [endpoint('/arm', tf_type), endpoint('/leg', tf_type)]
    robot.node.wait(3.0)
    assert not listens(robot)


def test_frames_beyond_the_limit_and_empty_ones_are_those_of_the_first_lidar(start_core, tf_type):
    scans, _ = drive_of_two_lidars()
    robot = start_core(mounting='tf')
    robot.receive('/tf_static', tf_type(transforms=[transform('base_link', f'lidar_{k}', SE2(0.1 * k))
                                                    for k in range(10)]))
    fronts = [scan for scan in scans if scan.frame_id == 'front']
    robot.play(dataclasses.replace(scan, frame_id=f'lidar_{k}') for k, scan in enumerate(fronts[:10]))
    assert '(lidar_0, lidar_1, lidar_2, lidar_3, lidar_4, lidar_5, lidar_6, lidar_7)' in robot.log
    assert robot.log.count('another lidar on this topic: each frame is a lidar of its own') == 7
    assert "/scan:lidar_0: the scans change from the frame 'lidar_0' to 'lidar_8'" in robot.log
    robot.play([dataclasses.replace(fronts[10], frame_id='')])
    assert "no transform from 'base_link' to ''" in robot.log
