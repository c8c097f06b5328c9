# SPDX-License-Identifier: Apache-2.0
"""One node with two lidars on one topic, each with a frame of its own."""
import dataclasses
import math
import re

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from nav_msgs.msg import Odometry
from ros_helpers import LATCHED, Loudspeaker, pose_of, said, transform
from sensor_msgs.msg import LaserScan
from two_lidars import FRONT, REAR, drive_of_two_lidars

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import scan_to_message

MOUNTINGS = {'front': FRONT, 'rear': REAR}
ANOTHER = '/scan:rear: another lidar on this topic: each frame is a lidar of its own (front, rear)'
MS = 1_000_000
MERGED = {'front': '/scan', 'rear': '/scan'}


@pytest.fixture(scope='module')
def drive():
    return drive_of_two_lidars()


def transforms(tf_type, frames=MOUNTINGS):
    return tf_type(transforms=[transform('base_link', frame, MOUNTINGS[frame]) for frame in frames])


class Lidars:
    """Publishes scans, each on the topic of its frame, and keeps the odometry of the node."""

    def __init__(self, peer, topics):
        self._peer = peer
        publishers = {topic: Loudspeaker(peer, LaserScan, topic) for topic in dict.fromkeys(topics.values())}
        self.publishers = {frame: publishers[topic] for frame, topic in topics.items()}
        self.found = peer.subscribe(Odometry, '/odom')

    def play(self, scans, waited_for='front'):
        """Send the `scans`; after each of the lidar `waited_for`, its odometry has come before the next is sent."""
        for scan in scans:
            count = len(self.found)
            self.publishers[scan.frame_id].tell(scan_to_message(scan))
            if scan.frame_id == waited_for:
                self._peer.until(lambda count=count: len(self.found) > count)

    def poses(self):
        """Stamp -> pose of the odometry so far."""
        return {in_nanoseconds(message.header.stamp): pose_of(message) for message in self.found}


def distances(poses, base_at):
    """Distance [m] of each pose from the true motion of the base since the first."""
    origin = base_at(min(poses))
    errors = [(origin.inverse() @ base_at(stamp)).inverse() @ pose for stamp, pose in poses.items()]
    return np.array([math.hypot(error.x, error.y) for error in errors])


def test_a_lidar_that_begins_later_joins_without_a_jump(start_command, peer, drive, tf_type):
    """Its transform comes even later; then the first lidar becomes silent."""
    scans, base_at = drive
    node = start_command('scan_matcher')
    said(node, 'ready: /scan -> /odom', peer)
    static = Loudspeaker(peer, tf_type, '/tf_static', LATCHED)
    static.tell(transforms(tf_type, ['front']))
    lidars = Lidars(peer, MERGED)
    start, known, silent, end = (scans[0].stamp + 1000 * MS * k for k in (1, 2, 3, 4))
    lidars.play(scan for scan in scans if scan.stamp < start and scan.frame_id == 'front')
    lidars.play(scan for scan in scans if start <= scan.stamp < known)
    said(node, ANOTHER, peer)
    said(node, "/scan:rear: scan skipped: no transform from 'base_link' to 'rear'", peer)
    static.tell(transforms(tf_type))
    lidars.play(scan for scan in scans if known <= scan.stamp < silent)
    lidars.play([scan for scan in scans if silent <= scan.stamp < silent + 200 * MS and scan.frame_id == 'rear'], None)
    rears = [scan for scan in scans if silent + 200 * MS <= scan.stamp < end and scan.frame_id == 'rear']
    lidars.play(rears, 'rear')
    poses = lidars.poses()
    assert list(poses) == sorted(poses) and max(np.diff(list(poses))) < 300 * MS
    assert distances(poses, base_at).max() < 0.03
    lidars.publishers['rear'].until(lambda: re.search(
        r'no scans on /scan:front: .*; the odometry continues with the other lidars', node.output()),
        scan_to_message(rears[-1]))
    assert node.output().count('another lidar on this topic') == 1 and 'odometry reset' not in node.output()


def test_frames_beyond_the_limit_and_empty_ones_are_those_of_the_first_lidar(start_command, peer, drive, tf_type):
    scans, _ = drive
    node = start_command('scan_matcher')
    said(node, 'ready: ', peer)
    Loudspeaker(peer, tf_type, '/tf_static', LATCHED).tell(tf_type(
        transforms=[transform('base_link', f'lidar_{k}', SE2(0.1 * k)) for k in range(10)]))
    lidars = Lidars(peer, {f'lidar_{k}': '/scan' for k in range(10)} | {'': '/scan'})
    fronts = [scan for scan in scans if scan.frame_id == 'front']
    lidars.play([dataclasses.replace(fronts[0], frame_id='lidar_0')], 'lidar_0')
    lidars.play([dataclasses.replace(scan, frame_id=f'lidar_{k}') for k, scan in enumerate(fronts[1:10], 1)], None)
    said(node, '(lidar_0, lidar_1, lidar_2, lidar_3, lidar_4, lidar_5, lidar_6, lidar_7)', peer)
    said(node, "/scan:lidar_0: the scans change from the frame 'lidar_0' to 'lidar_8'", peer)
    lidars.play([dataclasses.replace(fronts[10], frame_id='')], None)
    said(node, "no transform from 'base_link' to ''", peer)
    assert node.output().count('another lidar on this topic') == 7
