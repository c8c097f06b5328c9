# SPDX-License-Identifier: Apache-2.0
"""One node with two lidars, on topics of their own."""
import dataclasses
import math
import re

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from ros_helpers import LATCHED, Loudspeaker, Parameters, diagnosis, pose_of, said, transform
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger
from two_lidars import FRONT, REAR, drive_of_two_lidars

from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import scan_to_message
from dbscan_reg_ros.recordings.snapshots import read_snapshot

MS = 1_000_000


@pytest.fixture(scope='module')
def drive():
    return drive_of_two_lidars()


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


def played(peer, scans, late):
    """The odometry of the node while `scans` are sent, those of the rear lidar stamped `late` [ns].

    After each scan of the front lidar, its odometry has come before the next scan is sent.
    """
    lidars = {name: Loudspeaker(peer, LaserScan, f'/{name}/scan') for name in ('front', 'rear')}
    found = peer.subscribe(Odometry, '/odom')
    for scan in scans:
        count, rear = len(found), scan.frame_id == 'rear'
        lidars[scan.frame_id].tell(scan_to_message(dataclasses.replace(scan, stamp=scan.stamp + late * rear)))
        if not rear:
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
