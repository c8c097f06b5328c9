# SPDX-License-Identifier: Apache-2.0
"""Several lidars in the node, on topics of their own or on one; 3D lidars; without DDS."""
import dataclasses
import math
import re
from collections import deque

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from clouds import cloud_of, mast
from core_stand_in import StandIn, endpoint, stamps
from ros_helpers import distances, of_base, pose_of, transform
from sensor_msgs.msg import LaserScan, PointCloud2
from two_lidars import FRONT, REAR, drive_of_two_lidars

from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.calibration.compared_lidar import ComparedLidar
from dbscan_reg_ros.core.odometry.calibration.relative_pose import Comparison, RelativePose
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.lidar import Lidar, OdometryTrigger
from dbscan_reg_ros.node.monitoring.disagreements import Disagreements, OwnBodies
from dbscan_reg_ros.recordings.snapshots import read_snapshot
from dbscan_reg_ros.robot.own_body import BodySector

HOUR = 3600 * 10 ** 9
MS = 1_000_000
MOUNTINGS = {'front': FRONT, 'rear': REAR}


@pytest.fixture(scope='module')
def both():
    return drive_of_two_lidars()


def static(tf_type, frames=('front', 'rear')):
    return tf_type(transforms=[transform('base_link', frame, MOUNTINGS[frame]) for frame in frames])


def send(robot, scans, late=0, topic='/{}/scan'):
    """Let scans arrive on the topics of their lidars, those of the rear one stamped `late` [ns]."""
    for scan in scans:
        shifted = dataclasses.replace(scan, stamp=scan.stamp + late * (scan.frame_id == 'rear'))
        robot.receive(topic.format(scan.frame_id), shifted)
    robot.node.wait(0.2)


def off(robot, base_at):
    """Distances [m] of the odometry from the true motion of the base since the first scan."""
    found = robot.sent('/odom')
    origin = base_at(in_nanoseconds(found[0].header.stamp))
    errors = [(origin.inverse() @ base_at(in_nanoseconds(message.header.stamp))).inverse() @ pose_of(message)
              for message in found]
    return np.array([math.hypot(error.x, error.y) for error in errors])


def test_odometry_is_due_for_the_first_lidar_that_publishes():
    trigger = OdometryTrigger(2)
    # The first lidar each 80 ms; the second each 67 ms, from 20 ms on.
    assert trigger.is_due(1, 20 * MS)
    assert all(trigger.is_due(0, 80 * k * MS) for k in (1, 2, 3))
    assert not trigger.is_due(1, 250 * MS) and not trigger.is_due(1, 380 * MS)
    # Silent for more than two of its periods, and back.
    assert trigger.is_due(1, 420 * MS) and trigger.is_due(1, 490 * MS)
    assert not trigger.is_due(0, 480 * MS)
    assert trigger.is_due(0, 560 * MS) and not trigger.is_due(1, 570 * MS)
    # One lidar: every scan, even with a stamp that is not later.
    alone = OdometryTrigger(1)
    assert all(alone.is_due(0, stamp) for stamp in (5, 5, 3))
    # All scans, in the order of their stamps.
    of_all = OdometryTrigger(2, on_all=True)
    assert [of_all.is_due(lidar, stamp * MS) for lidar, stamp in ((0, 80), (1, 90), (0, 160), (1, 155), (1, 220))] == [
        True, True, True, False, True]


@pytest.fixture
def pair(start_core, tf_type, tmp_path):
    """``pair(**parameters)``: a core with two lidars, whose transforms are known."""
    def pair(**parameters):
        robot = start_core(mounting='tf', scan_topics=('front/scan', 'rear/scan'),
                           advanced__snapshot__folder=str(tmp_path), **parameters)
        robot.receive('/tf_static', static(tf_type))
        return robot
    return pair


def test_scans_are_used_in_the_order_of_their_stamps(pair, both):
    """Six scans come at once, first those of the rear lidar; all have come before the wait for them ends."""
    scans, _ = both
    robot = pair(advanced__input__reorder=1.0)
    send(robot, scans[:8])
    count, more = len(robot.sent('/odom')), sorted(scans[8:14], key=lambda scan: scan.frame_id, reverse=True)
    send(robot, more)
    assert len(robot.sent('/odom')) == count + sum(scan.frame_id == 'front' for scan in more)
    robot.node.wait(1.0)
    used = [update.stamp for update in read_snapshot(robot.call('/scan_matcher/snapshot').message).updates]
    assert used == sorted(scan.stamp for scan in scans[:14])


def test_a_further_lidar_whose_stamps_start_again_resets_nothing(pair, both):
    scans, base_at = both
    robot = pair()
    send(robot, scans[:20])
    send(robot, scans[20:50], -HOUR)
    assert re.search(r'/rear/scan: its clock is (3599\.9|3600\.\d) s behind that of the first lidar',
                     robot.diagnosis().message)
    assert 'odometry reset' not in robot.log
    assert off(robot, base_at)[-1] < 0.03


def test_a_lidar_that_begins_later_on_the_same_topic_joins_without_a_jump(start_core, both, tf_type):
    """Its transform comes even later; then the first lidar becomes silent."""
    scans, base_at = both
    robot = start_core(mounting='tf')
    robot.receive('/tf_static', static(tf_type, ['front']))
    begin, known, silent, end = (scans[0].stamp + 1000 * MS * k for k in (1, 2, 3, 4))
    send(robot, (s for s in scans if s.stamp < begin and s.frame_id == 'front'), topic='/scan')
    send(robot, (s for s in scans if begin <= s.stamp < known), topic='/scan')
    assert robot.log.count('/scan:rear: another lidar on this topic: each frame is a lidar of its own (front, '
                           'rear)') == 1
    assert "/scan:rear: scan skipped: no transform from 'base_link' to 'rear'" in robot.log
    assert robot.diagnosis().message.startswith("tracking; /scan:rear: no transform from 'base_link' to 'rear'")
    robot.receive('/tf_static', static(tf_type))
    send(robot, (s for s in scans if known <= s.stamp < silent), topic='/scan')
    for scan in (s for s in scans if silent <= s.stamp < end and s.frame_id == 'rear'):
        send(robot, [scan], topic='/scan')
        robot.node.wait(0.3)
    found = stamps(robot.sent('/odom'))
    assert found == sorted(found) and max(np.diff(found)) < 300 * MS
    fronts = {scan.stamp for scan in scans if scan.frame_id == 'front'}
    assert {stamp for stamp in found if stamp < silent} <= fronts and found[-1] > silent + 500 * MS
    assert off(robot, base_at).max() < 0.03
    assert re.search(r'no scans on /scan:front: .*; the odometry continues with the other lidars', robot.log)
    assert 'odometry reset' not in robot.log


def compared(given, estimate, late=0.0):
    """A lidar whose scans show another mounting and stamps that are late [s]."""
    found = Comparison(estimate, 1e-6 * np.eye(3), np.zeros(3), np.eye(3), 0)
    return ComparedLidar(given, deque([found] * 30), disagrees=True,
                         _estimate=RelativePose(estimate, -late, 1e-6 * np.eye(4)))


@pytest.fixture
def node():
    return StandIn()


def test_two_lidars_that_disagree_are_both_named_and_logged_once_with_what_to_do(node):
    """Mounted with a yaw of 90 deg, which is wrong by 3 deg, and stamped 60 ms late, 20 ms of which are corrected."""
    front, rear = (Lidar(f'{name}/scan', True, node, None, rank) for rank, name in enumerate(('front', 'rear')))
    rear.input = dataclasses.replace(rear.input, time_offset=[-0.02])
    rear.counters.mounting = Mounting(SE2(-0.4, 0.2, math.radians(90.0)))
    rear.counters.compared = compared(SE2(-0.4, 0.2), SE2(-0.36, 0.23, math.radians(-3.0)), late=0.04)
    disagreements = Disagreements()
    expected = ['/front/scan: disagrees with the other lidar, and one of both is wrong: its mounting is off by ',
                '/rear/scan: disagrees with the first lidar, and one of both is wrong: its mounting is off by 5.0 cm '
                'and 3.0 deg and its stamps are off by 40 ms']
    for _ in range(2):
        found = list(disagreements.found([front, rear]))
        assert [text.startswith(begin) for text, begin in zip(found, expected, strict=True)] == [True, True]
    of_front, of_rear = node.said
    assert of_rear == (f'{expected[1]}; it is not used until it agrees; set its transform to x -0.360 m, '
                       'y 0.230 m, yaw 1.5184 rad (87.00 deg) and set input.time_offset of it to -0.060')
    assert 'the others are not used until they agree with it; set its transform to x ' in of_front
    (key, value), = disagreements.estimates([front, rear])
    assert key == '/rear/scan: mounting and time offset by the scans'
    assert value == ('x -0.360 +- 0.001 m, y 0.230 +- 0.001 m, yaw 87.00 +- 0.06 deg, -0.060 +- 0.001 s')
    rear.counters.compared.apart = -2.04
    assert disagreements.clocks([front, rear]) == ['/rear/scan: its clock is 2.0 s behind that of the first lidar']
    assert 'it is not used; synchronise the clocks' in node.said[-1]
    rear.counters.compared.disagrees = False
    assert not list(disagreements.found([front, rear]))
    # A lidar of which hardly a scan was located over a long drive is named, too.
    rear.counters.compared = ComparedLidar(SE2(-0.4, 0.2), deque(), driven=16.0, turned=3.0)
    assert not list(disagreements.found([front, rear]))
    rear.counters.compared.turned = 4.2
    expected = '/rear/scan: is not used, as its scans do not fit the map of the first lidar: check the transforms '
    assert [text.startswith(expected) for text in (*disagreements.found([front, rear]),
                                                   *disagreements.found([front, rear]))] == [True, True]
    assert [text.startswith(expected) for text in node.said[3:]] == [True]


def test_a_lidar_that_sees_the_robot_is_named_and_logged_once_with_its_mask(node):
    front, rear = (Lidar(f'{name}/scan', True, node, None) for name in ('front', 'rear'))
    rear.name = 'rear'
    rear.input = dataclasses.replace(rear.input, mask=(0.0, 0.0, 2.0, 2.4, 0.0, 0.0, 0.0, 0.0))
    rear.counters.mounting = Mounting(SE2(theta=math.pi))
    rear.counters.body.sectors = [BodySector(math.radians(90.0), math.radians(110.0), 0.3)]
    bodies = OwnBodies()
    expected = '/rear/scan: sees the robot itself: from -90 to -70 deg at 0.30 m'
    assert [list(bodies.found([front, rear])) for _ in range(2)] == [[expected]] * 2
    assert node.said == [f'{expected}; set rear.mask to [2.0, 2.4, -1.571, -1.222, 0.0, 0.0, 0.0, 0.0], which includes '
                         'a margin of 2 deg at both ends']
    rear.counters.body.sectors = []
    assert not list(bodies.found([front, rear]))


# 3D lidars


def test_only_messages_of_the_given_type_are_received(start_core, scans):
    """Two lidars on one topic: the one with the other type is named, not used."""
    robot = start_core(input__type='sensor_msgs/PointCloud2', input__height_min=-0.6)
    [subscription] = [each for each in robot.node.subscriptions if each.topic_name == '/scan']
    assert subscription.msg_type is PointCloud2
    robot.node.others['/scan'] = [endpoint('/flat', LaserScan), endpoint('/mast', PointCloud2)]
    assert robot.play([cloud_of(scans[5], tilted=False)])[0] is not None
    assert ('/flat publishes sensor_msgs/msg/LaserScan on /scan; expected sensor_msgs/msg/PointCloud2: '
            'its messages are not received') in robot.diagnosis().message
    assert 'subscribed to sensor_msgs' not in robot.log
    floor = dataclasses.replace(scans[5], ranges=np.full(scans[5].geometry.size, np.inf))
    assert robot.play([cloud_of(floor, tilted=False)]) == [None]


def test_a_tilted_3d_lidar_gives_the_odometry_of_the_base(start_core, scans, truth, tf_type):
    """The node subscribes to the type that is published."""
    robot = start_core(mounting='tf')
    robot.receive('/tf_static', tf_type(transforms=[mast()]))
    robot.node.others['/scan'] = [endpoint('/mast', PointCloud2)]
    robot.node.wait(2.0)
    assert robot.log.count('/scan: subscribed to sensor_msgs/PointCloud2') == 1
    answers = robot.play(map(cloud_of, scans[:40]))
    assert distances(answers, of_base(truth[:40], SE2(0.2, -0.1))).max() < 0.03
    assert 'skipped' not in robot.log and 'expected sensor_msgs/msg/LaserScan' not in robot.log
