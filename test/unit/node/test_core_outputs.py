# SPDX-License-Identifier: Apache-2.0
"""What the node publishes for a scan, between two, and for people to look at; without DDS."""
import math

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from core_stand_in import endpoint, stamps, values
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy
from ros_helpers import pose_of
from scipy.spatial import cKDTree
from sensor_msgs.msg import PointField
from visualization_msgs.msg import Marker

from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.graph_checks import full_name, named

MS = 1_000_000


def test_between_scans_odom_and_transform_are_predicted(start_core, scans, tf_type):
    """Stamps of odom increase, every scan has its transform, and nothing is sent after `coast_time` or in a pause."""
    robot = start_core(publish_rate=50.0)
    robot.play(scans[:20])

    def at(stamp):
        robot.node.now = stamp
        robot.node.wait(0.02)

    last, sent = robot.sent('/odom')[-1], len(robot.sent('/odom'))
    for ahead in 40, 80, 150, 900, 1100, 1200:
        at(scans[19].stamp + ahead * MS)
    odom = robot.sent('/odom')
    assert [stamp - scans[19].stamp for stamp in stamps(odom[sent:])] == [ahead * MS for ahead in (40, 80, 150, 900)]
    velocity, before, after = last.twist.twist.linear, pose_of(last), pose_of(odom[21])
    assert math.hypot(after.x - before.x, after.y - before.y) == pytest.approx(
        0.08 * math.hypot(velocity.x, velocity.y), rel=1e-3)
    assert odom[22].pose.covariance[0] > odom[20].pose.covariance[0] > last.pose.covariance[0]
    robot.play(scans[20:30])
    transforms = [message.transforms[0] for message in robot.sent('/tf')]
    assert {*stamps(odom), *(scan.stamp for scan in scans[:30])} == {*stamps(transforms)}
    sent = stamps(robot.sent('/odom'))
    assert sent == sorted(set(sent))
    assert robot.call('/scan_matcher/pause', data=True).success
    at(scans[29].stamp + 20 * MS)
    assert len(robot.sent('/tf')) == len(transforms) == 34


def test_a_clock_that_is_not_that_of_the_scans_is_named_where_odometry_between_them_is_asked_for(start_core, scans):
    robot = start_core(publish_rate=50.0)
    robot.play(scans[:2])
    robot.node.now = scans[1].stamp + 5000 * MS
    robot.node.wait(0.2)
    assert len(robot.sent('/odom')) == 2
    assert robot.log.count('publish_rate has no effect: the last scan is 5.000 s older than the clock') == 1


def test_segments_show_reference_and_scan_with_matched_ones_apart(start_core, scans):
    robot = start_core()
    robot.node.unwatched.add('/segments')
    robot.play(scans[:1])
    assert not robot.sent('/segments')
    robot = start_core()
    robot.play(scans[:3])
    arrays = robot.sent('/segments')
    for scan, message in zip(scans[:3], arrays, strict=True):
        assert {(m.ns, m.id) for m in message.markers} == {(n, i) for n in ('reference', 'current') for i in (0, 1)}
        assert {m.header.frame_id for m in message.markers} == {'odom'}
        assert {in_nanoseconds(m.header.stamp) for m in message.markers} == {scan.stamp}
        for marker in message.markers:
            assert marker.type == Marker.LINE_LIST
            assert (marker.action == Marker.DELETE) == (not marker.points)
            assert len(marker.points) % 2 == 0
    first, last = ({(m.ns, m.id): len(m.points) // 2 for m in a.markers} for a in (arrays[0], arrays[-1]))
    assert first['reference', 0] == first['reference', 1] == first['current', 1] == 0
    assert first['current', 0] > 3 and last['reference', 1] > 3 and last['current', 1] > 3
    assert len({(m.color.r, m.color.g, m.color.b) for m in arrays[-1].markers}) == 4


def points_of(message):
    assert [(f.name, f.offset, f.datatype, f.count) for f in message.fields] == [
        ('x', 0, PointField.FLOAT32, 1), ('y', 4, PointField.FLOAT32, 1), ('z', 8, PointField.FLOAT32, 1)]
    assert (message.height, message.point_step, message.row_step) == (1, 12, 12 * message.width)
    assert not message.is_bigendian
    return np.frombuffer(message.data, np.float32).reshape(message.width, 3)


@pytest.fixture
def driven(start_core, scans):
    """A core that draws, and has come to the end of a drive."""
    robot = start_core(advanced__path__step=0.2, publish_grid=True, grid_resolution=0.1)
    robot.node.unwatched |= {'/path', '/local_map'}
    robot.play(scans[:10])
    robot.node.wait(1.0)
    assert not robot.sent('/path') and not robot.sent('/local_map')
    robot.node.unwatched.clear()
    robot.play(scans[10:])
    robot.node.wait(1.0)
    assert stamps(robot.sent('/path'))[-1] == stamps(robot.sent('/local_map'))[-1] == scans[-1].stamp
    for topic in '/path', '/local_map', '/local_grid':
        assert {message.header.frame_id for message in robot.sent(topic)} == {'odom'}
    return robot


def test_the_path_shows_where_the_base_has_been(driven, scans, truth):
    path, true = driven.sent('/path')[-1], {scan.stamp: pose for scan, pose in zip(scans, truth, strict=True)}
    assert {stamped.header.frame_id for stamped in path.poses} == {'odom'}
    for stamped in path.poses:
        pose, q = true[in_nanoseconds(stamped.header.stamp)], stamped.pose.orientation
        assert np.hypot(stamped.pose.position.x - pose.x, stamped.pose.position.y - pose.y) < 0.05
        assert abs(q.z**2 + q.w**2 - 1.0) < 1e-12
    steps = np.diff([[p.pose.position.x, p.pose.position.y] for p in path.poses[:-1]], axis=0)
    assert len(steps) > 5 and (np.hypot(*steps.T) >= 0.2).all()


def test_the_local_map_and_the_grid_show_the_walls(driven, scans, truth):
    points = points_of(driven.sent('/local_map')[-1])
    assert len(points) > 100 and (points[:, 2] == 0.0).all()
    returns = [pose.apply(scan.points[scan.valid]) for scan, pose in zip(scans, truth, strict=True)]
    assert np.median(cKDTree(np.concatenate(returns)).query(points[:, :2])[0]) < 0.03
    [publisher] = [each for each in driven.node.publishers if each.topic_name == '/local_grid']
    assert publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    grid, info = publisher.sent[-1], publisher.sent[-1].info
    assert info.resolution == np.float32(0.1)
    cells = np.pad(np.array(grid.data, dtype=int).reshape(info.height, info.width), 1, constant_values=-1)
    assert set(cells.ravel()) == {-1, 0, 100}
    corner = np.array((info.origin.position.x, info.origin.position.y))

    def at(points):
        x, y = np.floor((points - corner) / 0.1).astype(int).T + 1
        return cells[y, x]

    # Returns of a scan amid the drive lie in occupied cells or beside one; where the robot has been is free.
    around = np.stack([at(returns[20] + 0.1 * np.array((dx, dy))) for dx in (-1, 0, 1) for dy in (-1, 0, 1)])
    assert (around.max(axis=0) == 100).mean() > 0.9
    assert (at(np.array([pose.as_array()[:2] for pose in truth[:60]])) == 0).all()


# Diagnostics


def test_tracking_is_ok_with_rates_timing_and_counts(start_core, scans):
    robot = start_core()
    for scan in scans[:40]:
        robot.play([scan])
        robot.node.wait(0.1)
    last, status = (report.status[0] for report in robot.sent('/diagnostics')[-2:])
    for each in last, status:
        assert (each.level, each.message, each.hardware_id) == (DiagnosticStatus.OK, 'tracking', 'laser')
    numbers = values(last)
    assert float(numbers['scan rate [Hz]']) == pytest.approx(10.0, abs=1.1)
    assert float(numbers['odometry rate [Hz]']) == pytest.approx(10.0, abs=1.1)
    assert 0.0 < float(numbers['processing time median [ms]']) <= float(numbers['processing time maximum [ms]'])
    assert float(numbers['overlap']) > 0.7
    assert numbers['scans dropped'] == numbers['scans skipped'] == '0'
    assert numbers['scans processed'] == numbers['status ok']
    robot.node.wait(3.0)
    silent = robot.diagnosis()
    assert silent.level == DiagnosticStatus.STALE and silent.message.startswith('no scans on /scan: ')
    assert values(silent)['scans processed'] == '40'


def test_another_publisher_on_our_odometry_is_named(start_core, scans):
    robot = start_core()
    robot.play(scans[:3])
    robot.node.others['/odom'] = [endpoint('/base_driver', Odometry)]
    reported = '/odom is also published by /base_driver: subscribers receive two odometries mixed; remap ours'
    for _ in range(2):
        robot.play(scans[3:6])
        status = robot.diagnosis()
        assert status.level == DiagnosticStatus.WARN and reported in status.message
    assert robot.log.count(reported) == 1
    robot.node.others['/odom'] = [endpoint('/scan_matcher', Odometry)]
    assert '/odom is also published by another node named /scan_matcher' in robot.diagnosis().message
    robot.node.others.clear()
    assert '/odom' not in robot.diagnosis().message


@pytest.fixture
def unnamed():
    """A publisher that is discovered before its node, as rmw reports it."""
    found = endpoint('/unknown', Odometry)
    found.node_name, found.node_namespace = '_NODE_NAME_UNKNOWN_', '_NODE_NAMESPACE_UNKNOWN_'
    return found


def test_a_node_that_is_not_discovered_is_unnamed(unnamed):
    assert full_name(unnamed) == 'an unnamed node'
    assert named([unnamed, endpoint('/_ros2cli_17', Odometry), unnamed]) == '/_ros2cli_17, an unnamed node'
    assert named([]) == ''


def test_a_publisher_without_a_name_is_logged_if_it_has_none_a_second_later(start_core, unnamed):
    robot = start_core()
    robot.node.others['/odom'] = [unnamed]
    for count in 0, 1, 1:
        assert '/odom is also published by an unnamed node' in robot.diagnosis().message
        assert robot.log.count('an unnamed node') == count
