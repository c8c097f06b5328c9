# SPDX-License-Identifier: Apache-2.0
"""Which scans are used, and which of their beams."""
import dataclasses
import math

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from ros_helpers import TIMEOUT, Loudspeaker, changed, distances, restamped, said
from sensor_msgs.msg import LaserScan

from dbscan_reg_ros.core.geometry.mounting import Mounting
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import scan_to_message
from dbscan_reg_ros.replays.lidars import prepared
from dbscan_reg_ros.robot.mask import within
from dbscan_reg_ros.robot.parameter_groups import InputParameters


@pytest.mark.parametrize('sector, inside', [
    ((0.5, 1.0), [0.5, 0.7, 1.0]),
    ((1.0, 0.5), [1.1, 3.0, -3.0, 0.0, 0.4]),
    ((3.0, -3.0), [3.1, -3.1]),
    ((3.0, 3.3), [3.1, -3.1]),
    ((-math.pi, math.pi), [0.0, 2.0, -2.0]),
])
def test_sectors_go_counter_clockwise_across_the_seam(sector, inside):
    assert within(np.array(inside), np.array([sector])).all()


def test_bearings_outside_all_sectors_are_kept():
    bearings = np.array([0.0, 0.4, 1.1, 3.0, -3.0])
    assert not within(bearings, np.array([[0.5, 1.0], [3.05, 3.1]])).any()


def test_a_revolution_in_several_messages_is_assembled_and_reported(start_node, peer, scans, truth):
    node = start_node()
    found, lidar = peer.subscribe(Odometry, 'odom'), Loudspeaker(peer, LaserScan, 'scan')
    geometry, kept = scans[0].geometry, scans[:8]
    size, step = geometry.size // 12, (kept[1].stamp - kept[0].stamp) // 12
    sectors = [changed(scan, angle_min=geometry.angle_min + k * size * geometry.angle_increment,
                       ranges=scan.ranges[k * size:(k + 1) * size].tolist(),
                       header=scan_to_message(restamped([scan], [scan.stamp + k * step])[0]).header)
               for scan in kept for k in range(12)]
    lidar.until(lambda: found, sectors[0])
    # The revolutions begin with the second sector.
    for first in range(1, len(sectors) - 11, 12):
        lidar.tell(*sectors[first:first + 12])
        stamp = in_nanoseconds(sectors[first].header.stamp)
        peer.until(lambda stamp=stamp: in_nanoseconds(found[-1].header.stamp) == stamp)
    assert distances(found[-7:], truth[:7]).max() < 0.05
    said(node, 'a revolution comes in up to', peer)


def test_every_nth_scan_is_used(start_node, player, scans, truth):
    start_node('-p', 'input.every_nth:=4')
    player.wait_for_node(TIMEOUT)
    answers = player.play(scans[:40], rate=4.0, patience=0.5)
    assert [k for k, message in enumerate(answers.messages) if message] == list(range(0, 40, 4))
    assert distances([m for m in answers.messages if m], truth[0:40:4]).max() < 0.1


def test_of_scans_that_come_too_fast_the_newest_win_and_the_others_are_counted(node, peer, scans):
    publisher = Loudspeaker(peer, LaserScan, 'scan').publisher
    answers = peer.listen(Odometry, 'odom')
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    messages = list(map(scan_to_message, restamped(scans, scans[0].stamp + 100_000 * np.arange(len(scans)))))
    for message in messages:
        publisher.publish(message)
    peer.until(lambda: answers and answers[-1].header.stamp == messages[-1].header.stamp)
    assert len(answers) < 80
    stamps = [in_nanoseconds(m.header.stamp) for m in answers]
    assert stamps == sorted(stamps)

    def counts():
        values = {v.key: v.value for v in reports[-1].status[0].values}
        return [int(values[f'scans {kind}']) for kind in ('received', 'processed', 'dropped')]

    peer.until(lambda: reports and counts()[1] == len(answers))
    received, processed, dropped = counts()
    assert received == processed + dropped
    said(node, 'too slow: ', peer)
    assert received > 50


def test_all_scans_of_a_burst_are_used(node, peer, scans, truth):
    publisher = Loudspeaker(peer, LaserScan, 'scan').publisher
    answers = peer.subscribe(Odometry, 'odom')
    for begin in range(0, 75, 25):
        for scan in scans[begin:begin + 25]:
            publisher.publish(scan_to_message(scan))
        peer.until(lambda end=begin + 25: len(answers) == end)
    assert distances(answers, truth[:75]).max() < 0.1


def test_a_masked_sector_without_a_beam_is_named(scans):
    ahead = dataclasses.replace(scans[0].geometry, angle_min=float(scans[0].geometry.bearings[90]), size=180)
    half = [dataclasses.replace(scan, ranges=scan.ranges[90:270], geometry=ahead) for scan in scans[:4]]
    notes, given = [], InputParameters(mask=(2.0, 2.5, -0.1, 0.1, *[0.0] * 4))
    assert len(list(prepared(half, Mounting(), given, notes.append))) == 4
    assert {note.startswith('input.mask has 2 to 2.5 rad, where the lidar has no beam') for note in notes} == {True}
