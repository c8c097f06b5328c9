# SPDX-License-Identifier: Apache-2.0
"""Warnings about scans: of the command play, and of the node with several publishers."""
import array

import numpy as np
import pytest
from bags import needs_rosbags
from diagnostic_msgs.msg import DiagnosticArray
from ros_helpers import Loudspeaker, Peer, changed
from sensor_msgs.msg import LaserScan

from dbscan_reg_ros.node.interfaces.messages import scan_to_message, stamp_to_message


def warnings(process):
    """What a node has warned of, but for what becomes of the scans."""
    texts = [line.partition(']: ')[2] for line in process.output().splitlines() if '[WARN]' in line]
    return [text for text in texts if not text.startswith(('scan ', 'odometry ', 'tf2_msgs '))]


@pytest.fixture
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@needs_rosbags
@pytest.mark.usefixtures('in_an_empty_folder')
def test_play_says_it_once_at_its_end(cases, start_node, start_command, peer):
    start_node()
    command = start_command('play', '--rate', '5', str(cases / 'millimetres' / 'ranges_and_range_max'))
    peer.until(lambda: not command.running(), 60.0)
    assert command.output().count('the ranges look like millimetres') == 1


def test_two_publishers_of_one_lidar_are_named_and_nothing_else_is_accused(start_node, peer, scans):
    """The lidars look in opposite directions, and the clock of one is 0.15 s behind."""
    node = start_node('-p', 'advanced.input.queue_size:=50')
    received = peer.listen(DiagnosticArray, '/diagnostics')
    with Peer('left') as left, Peer('right') as right:
        speakers = [Loudspeaker(each, LaserScan, 'scan') for each in (left, right)]
        peer.greet()
        names = '/scan has 2 publishers whose scans have the same frame, /left, /right'
        # Few at once, as they wait in a queue, until one that fails comes after the publishers are counted.
        while f'scan could not be registered: {names}' not in node.output():
            reports, pairs, scans = len(received), scans[:20], scans[20:]
            assert pairs, node.output()
            for scan in pairs:
                late = changed(scan, ranges=array.array('f', np.roll(scan.ranges, 180)))
                late.header.stamp = stamp_to_message(scan.stamp - 150_000_000)
                for speaker, message in zip(speakers, (scan_to_message(scan), late), strict=True):
                    speaker.tell(message)
            peer.until(lambda reports=reports: len(received) > reports)
        peer.until(lambda: any(names in status.message for report in received for status in report.status))
    assert {text.partition(': expected')[0] for text in warnings(node)} == {names}
    assert 'max_' not in node.output() and 'stamp' not in node.output()
