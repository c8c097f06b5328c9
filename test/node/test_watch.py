# SPDX-License-Identifier: Apache-2.0
"""The live page of the real node, each in a process of its own, over DDS."""
import re

import numpy as np
import pytest
from events import Reader
from nav_msgs.msg import Odometry
from ros_helpers import TIMEOUT, mounted, pose_of, said

from dbscan_reg_ros import SE2


@pytest.fixture
def watch(start_command, peer):
    """``watch(*words) -> (process, port)`` of a page that listens."""
    def watch(*words):
        process = start_command('watch', *words)
        said(process, 'from another computer: ssh -L ', peer)
        return process, int(re.search(r'http://127\.0\.0\.1:(\d+)/', process.output())[1])
    return watch


def connected(process, port, peer, count=1):
    """Readers of the page, once it has subscribed."""
    readers = [Reader('127.0.0.1', port) for _ in range(count)]
    peer.until(lambda: peer.node.count_subscribers('/odom') >= 1 and 'a browser is connected' in process.output())
    return readers


def watched_from(reader, node):
    """Wait until the reader knows the node."""
    while reader.next('start')[1]['source'] != node:
        pass


def test_ten_browsers_see_the_scans_of_the_node_where_it_has_placed_them(start_node, watch, player, peer, scans):
    laser = SE2(0.3, -0.1, 0.4)
    start_node(*mounted(laser))
    process, port = watch()
    player.wait_for_node(TIMEOUT)
    assert peer.node.count_subscribers('/odom') == 1
    odometry = peer.listen(Odometry, '/odom')
    readers = connected(process, port, peer, 10)
    peer.until(lambda: peer.node.count_subscribers('/odom') == 3)
    for reader in readers:
        watched_from(reader, '/scan_matcher')
    with peer.spinning():
        assert player.play(scans[:40]).lost == 0
        events = {}
        while len(events) < 20:
            event = readers[0].next('scan')[1]
            events[round(event['time'], 6)] = event
    peer.until(lambda: len(odometry) == 40)
    placed = {round(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec, 6): pose_of(message) @ laser
              for message in odometry}
    for time, event in events.items():
        np.testing.assert_allclose(event['pose'], placed[time].as_array(), atol=1e-3)
    first = next(iter(events))
    for reader in readers[1:]:
        while round(reader.next('scan')[1]['time'], 6) != first:
            pass
    for reader in readers:
        reader.close()
    said(process, 'no browser is connected', peer)
    peer.until(lambda: peer.node.count_subscribers('/odom') == 2)


def test_the_page_goes_on_when_the_node_is_restarted(start_node, watch, player, peer, scans):
    process, port = watch()
    [reader] = connected(process, port, peer)
    for _ in range(2):
        node = start_node()
        watched_from(reader, '/scan_matcher')
        player.wait_for_node(TIMEOUT)
        with peer.spinning():
            player.play(scans[:15])
            event = reader.next('scan')[1]
        assert np.hypot(*event['pose'][:2]) < 0.5
        node.stop()
        peer.until(lambda: peer.node.count_publishers('/odom') == 0)
    assert process.running()
    reader.close()
    assert process.stop() == 0, process.output()
