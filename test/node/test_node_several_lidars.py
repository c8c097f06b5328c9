# SPDX-License-Identifier: Apache-2.0
"""One node with two lidars, on topics of their own."""
import dataclasses
import math
import re
from collections import deque

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from ros_helpers import LATCHED, Loudspeaker, Parameters, diagnosis, pose_of, said, transform
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger
from two_lidars import FRONT, REAR, drive_of_two_lidars

from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.calibration.compared_lidar import ComparedLidar
from dbscan_reg_ros.core.odometry.calibration.relative_pose import Comparison, RelativePose
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.lidar import Lidar, OdometryTrigger
from dbscan_reg_ros.node.interfaces.messages import scan_to_message
from dbscan_reg_ros.node.monitoring.disagreements import Disagreements, OwnBodies
from dbscan_reg_ros.recordings.snapshots import read_snapshot
from dbscan_reg_ros.robot.own_body import BodySector

HOUR = 3600 * 10 ** 9
MS = 1_000_000


@pytest.fixture(scope='module')
def drive():
    return drive_of_two_lidars()


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


def test_two_lidars_give_one_odometry_and_either_may_be_missing(start_command, peer, drive, tf_type):
    scans, base_at = drive
    node = start_command('scan_matcher', '--ros-args', '-p', 'scan_topics:=[front/scan, rear/scan]')
    said(node, 'ready: /front/scan, /rear/scan -> /odom', peer)
    lidars = {name: Loudspeaker(peer, LaserScan, f'/{name}/scan') for name in ('front', 'rear')}
    static = Loudspeaker(peer, tf_type, '/tf_static', LATCHED)
    found, statuses = peer.subscribe(Odometry, '/odom'), peer.listen(DiagnosticArray, '/diagnostics')
    start, stop, end = (scans[0].stamp + int(1e9 * seconds) for seconds in (1.5, 3.0, 4.5))

    def publish(chosen):
        """Publish scans one by one, each after the odometry of the last one that asks for it has come."""
        for scan in chosen:
            count = len(found)
            lidars[scan.frame_id].tell(scan_to_message(scan))
            if scan.frame_id == waited_for:
                peer.until(lambda count=count: len(found) > count)

    # The rear lidar has no transform yet: it is named, and the front one is used.
    static.tell(tf_type(transforms=[transform('base_link', 'front', FRONT)]))
    first = scan_to_message(scans[0])
    lidars['front'].until(lambda: found, first)
    waited_for = 'front'
    publish(scan for scan in scans[1:] if scan.stamp < start)
    said(node, "/rear/scan: scan skipped: no transform from 'base_link' to 'rear'", peer)
    # It joins when its transform comes.
    static.tell(tf_type(transforms=[transform('base_link', 'rear', REAR)]))
    publish(scan for scan in scans if start <= scan.stamp < stop)
    fronts = {scan.stamp for scan in scans if scan.frame_id == 'front'}
    assert {in_nanoseconds(message.header.stamp) for message in found} <= fronts
    # The front lidar dies: odometry goes on with the rear one after two periods.
    waited_for = None
    publish(scan for scan in scans if stop <= scan.stamp < stop + 200 * MS and scan.frame_id == 'rear')
    waited_for = 'rear'
    publish(scan for scan in scans if stop + 200 * MS <= scan.stamp < end and scan.frame_id == 'rear')
    report = diagnosis(peer, statuses, lambda status: '/front/scan' in status.message)
    assert 'no scans on /front/scan' in report.message
    values = {value.key: value.value for value in report.values}
    assert int(values['/rear/scan: scans received']) > int(values['/front/scan: scans received']) - 30
    skipped = [int(values[f'/{name}/scan: scans skipped']) for name in lidars]
    assert skipped[0] == 0 < skipped[1] == int(values['scans skipped'])
    rear = [scan for scan in scans if scan.frame_id == 'rear' and scan.stamp < end]
    lidars['rear'].until(lambda: re.search(
        r'no scans on /front/scan: .*; the odometry continues with the other lidars', node.output()),
        scan_to_message(rear[-1]))
    # And it comes back.
    waited_for = 'front'
    publish(scan for scan in scans if end <= scan.stamp < end + 500 * MS)
    stamps = [in_nanoseconds(message.header.stamp) for message in found]
    assert stamps == sorted(set(stamps)) and max(np.diff(stamps)) < 250 * MS
    origin = base_at(stamps[0])
    for message, stamp in zip(found, stamps, strict=True):
        true = origin.inverse() @ base_at(stamp)
        pose = pose_of(message)
        assert math.hypot(pose.x - true.x, pose.y - true.y) < 0.03


def loudspeakers(peer):
    return {name: Loudspeaker(peer, LaserScan, f'/{name}/scan') for name in ('front', 'rear')}


def played(peer, scans, late, lidars=None, waited_for='front'):
    """The odometry of the node while `scans` are sent, those of the rear lidar stamped `late` [ns].

    After each scan of the lidar `waited_for`, its odometry has come before the next scan is sent.
    """
    lidars = lidars or loudspeakers(peer)
    found = peer.subscribe(Odometry, '/odom')
    for scan in scans:
        count, rear = len(found), scan.frame_id == 'rear'
        lidars[scan.frame_id].tell(scan_to_message(dataclasses.replace(scan, stamp=scan.stamp + late * rear)))
        if scan.frame_id == waited_for:
            peer.until(lambda count=count: len(found) > count)
    return found


def only_the_rear_is_masked(peer, scans):
    """The scans that the node used are some of `scans`, and those of the rear lidar have no returns in the sector."""
    used = [update.scan for update in read_snapshot(
        peer.call(Trigger, '/scan_matcher/snapshot', Trigger.Request()).message).updates]
    assert {(scan.frame_id, scan.stamp) for scan in used} <= {(scan.frame_id, scan.stamp) for scan in scans}
    sector = (scans[0].geometry.bearings > 0.5) & (scans[0].geometry.bearings < 1.0)
    for name, masked in (('front', False), ('rear', True)):
        sectors = [np.isnan(scan.ranges[sector]).all() for scan in used if scan.frame_id == name]
        assert len(sectors) > 5 and set(sectors) == {masked}


def test_scans_are_used_in_the_order_of_their_stamps(start_command, peer, drive, tf_type, tmp_path):
    """Six scans come at once, first those of the rear lidar; all have come before the wait for them ends."""
    scans, _ = drive
    node = start_command('scan_matcher', '--ros-args', '-p', 'scan_topics:=[front/scan, rear/scan]',
                         '-p', 'advanced.input.reorder:=1.0', '-p', 'advanced.input.queue_size:=10', '-p',
                         f'advanced.snapshot.folder:={tmp_path}')
    said(node, 'ready: ', peer)
    Loudspeaker(peer, tf_type, '/tf_static', LATCHED).tell(tf_type(
        transforms=[transform('base_link', name, at) for name, at in (('front', FRONT), ('rear', REAR))]))
    lidars = loudspeakers(peer)
    found = played(peer, scans[:8], 0, lidars)
    count, more = len(found), sorted(scans[8:14], key=lambda scan: scan.frame_id, reverse=True)
    for scan in more:
        lidars[scan.frame_id].tell(scan_to_message(scan))
    peer.until(lambda: len(found) == count + sum(scan.frame_id == 'front' for scan in more))
    used = [update.scan.stamp for update in read_snapshot(
        peer.call(Trigger, '/scan_matcher/snapshot', Trigger.Request()).message).updates]
    last = max(scan.stamp for scan in more if scan.frame_id == 'front')
    assert [stamp for stamp in used if scans[8].stamp <= stamp <= last] == sorted(
        scan.stamp for scan in more if scan.stamp <= last)


def test_a_further_lidar_whose_stamps_start_again_resets_nothing(start_command, peer, drive, tf_type):
    scans, base_at = drive
    node = start_command('scan_matcher', '--ros-args', '-p', 'scan_topics:=[front/scan, rear/scan]')
    said(node, 'ready: ', peer)
    Loudspeaker(peer, tf_type, '/tf_static', LATCHED).tell(tf_type(
        transforms=[transform('base_link', name, at) for name, at in (('front', FRONT), ('rear', REAR))]))
    lidars, statuses = loudspeakers(peer), peer.listen(DiagnosticArray, '/diagnostics')
    found = played(peer, scans[:20], 0, lidars)
    found += played(peer, scans[20:50], -HOUR, lidars)
    assert diagnosis(peer, statuses, lambda status: re.search(
        r'/rear/scan: its clock is (3599\.9|3600\.\d) s behind that of the first lidar', status.message))
    assert 'odometry reset' not in node.output()
    last = found[-1]
    true = base_at(in_nanoseconds(found[0].header.stamp)).inverse() @ base_at(in_nanoseconds(last.header.stamp))
    assert math.hypot(pose_of(last).x - true.x, pose_of(last).y - true.y) < 0.03


def compared(given, estimate, late=0.0):
    """A lidar whose scans show another mounting and stamps that are late [s]."""
    found = Comparison(estimate, 1e-6 * np.eye(3), np.zeros(3), np.eye(3), 0)
    return ComparedLidar(given, deque([found] * 30), disagrees=True,
                         _estimate=RelativePose(estimate, -late, 1e-6 * np.eye(4)))


def test_two_lidars_that_disagree_are_both_named_and_logged_once_with_what_to_do(peer, capfd):
    """Mounted with a yaw of 90 deg, which is wrong by 3 deg, and stamped 60 ms late, 20 ms of which are corrected."""
    front, rear = (Lidar(f'{name}/scan', True, peer.node, None, rank) for rank, name in enumerate(('front', 'rear')))
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
    logged = capfd.readouterr().err
    assert logged.count('disagrees') == 2 and logged.endswith(
        f'{expected[1]}; it is not used until it agrees; set its transform to x -0.360 m, '
        'y 0.230 m, yaw 1.5184 rad (87.00 deg) and set input.time_offset of it to -0.060\n')
    assert 'the others are not used until they agree with it; set its transform to x ' in logged
    (key, value), = disagreements.estimates([front, rear])
    assert key == '/rear/scan: mounting and time offset by the scans'
    assert value == ('x -0.360 +- 0.001 m, y 0.230 +- 0.001 m, yaw 87.00 +- 0.06 deg, -0.060 +- 0.001 s')
    rear.counters.compared.apart = -2.04
    assert disagreements.clocks([front, rear]) == ['/rear/scan: its clock is 2.0 s behind that of the first lidar']
    assert 'it is not used; synchronise the clocks' in capfd.readouterr().err
    rear.counters.compared.disagrees = False
    assert not list(disagreements.found([front, rear]))
    # A lidar of which hardly a scan was located over a long drive is named, too.
    rear.counters.compared = ComparedLidar(SE2(-0.4, 0.2), deque(), driven=16.0, turned=3.0)
    assert not list(disagreements.found([front, rear]))
    rear.counters.compared.turned = 4.2
    expected = '/rear/scan: is not used, as its scans do not fit the map of the first lidar: check the transforms '
    assert [text.startswith(expected) for text in (*disagreements.found([front, rear]),
                                                   *disagreements.found([front, rear]))] == [True, True]
    assert capfd.readouterr().err.count(expected) == 1


def test_a_lidar_that_sees_the_robot_is_named_and_logged_once_with_its_mask(peer, capfd):
    front, rear = (Lidar(f'{name}/scan', True, peer.node, None) for name in ('front', 'rear'))
    rear.name = 'rear'
    rear.input = dataclasses.replace(rear.input, mask=(0.0, 0.0, 2.0, 2.4, 0.0, 0.0, 0.0, 0.0))
    rear.counters.mounting = Mounting(SE2(theta=math.pi))
    rear.counters.body.sectors = [BodySector(math.radians(90.0), math.radians(110.0), 0.3)]
    bodies = OwnBodies()
    expected = '/rear/scan: sees the robot itself: from -90 to -70 deg at 0.30 m'
    assert [list(bodies.found([front, rear])) for _ in range(2)] == [[expected]] * 2
    logged = capfd.readouterr().err
    assert logged.count('sees') == 1 and logged.endswith(
        f'{expected}; set rear.mask to [2.0, 2.4, -1.571, -1.222, 0.0, 0.0, 0.0, 0.0], which includes a margin of '
        '2 deg at both ends\n')
    rear.counters.body.sectors = []
    assert not list(bodies.found([front, rear]))


def test_lidars_with_names_have_parameters_of_their_own(start_command, peer, drive, tmp_path):
    """No transforms: the poses are parameters. The mask of the rear lidar is set while the node runs."""
    scans, base_at = drive
    file = tmp_path / 'lidars.yaml'
    file.write_text(f"""/**:
  ros__parameters:
    sensors: [front, back]
    front.laser_pose: {FRONT.as_array().tolist()}
    back:
      topic: rear/scan
      laser_pose: {REAR.as_array().tolist()}
      time_offset: [-0.06]
      range_max: 4.0
    scan.noise_min: 0.006
    advanced.snapshot.folder: {tmp_path}
""")
    node = start_command('scan_matcher', '--ros-args', '--params-file', str(file), '-p', 'front.rang_max:=5.0')
    said(node, 'ready: /front/scan, /rear/scan -> /odom', peer)
    assert "unknown parameter 'front.rang_max' is ignored; did you mean 'front.range_max'" in node.output()
    parameters = Parameters(peer)
    assert parameters.get('back.range_max', 'front.range_max', 'back.noise_min', 'front.topic', 'back.mounting') == [
        4.0, 0.0, 0.006, 'front/scan', 'laser_pose']
    refused, = parameters.set(back__mask=[0.5])
    assert refused.reason == 'back.mask = [0.5]: expected 8 numbers'
    assert parameters.set(back__mask=[0.5, 1.0, *[0.0] * 6])[0].successful
    found = played(peer, scans[:20], 60 * MS)
    origin = base_at(scans[0].stamp)
    for message in found:
        true, pose = origin.inverse() @ base_at(in_nanoseconds(message.header.stamp)), pose_of(message)
        assert math.hypot(pose.x - true.x, pose.y - true.y) < 0.03
    only_the_rear_is_masked(peer, scans)
