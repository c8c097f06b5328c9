# SPDX-License-Identifier: Apache-2.0
"""The live page of the real node, each in a process of its own, over DDS."""
import dataclasses
import re

import numpy as np
import pytest
from events import Reader
from nav_msgs.msg import Odometry
from ros_helpers import TIMEOUT, Loudspeaker, mounted, pose_of, said
from sensor_msgs.msg import LaserScan, PointCloud2
from test_node_point_cloud import cloud_of

from dbscan_reg_ros import SE2
from dbscan_reg_ros.node.interfaces.messages import scan_to_message

ALIVE = 14
"""Number of scans that the first lidar sends before it is silent."""


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
    events = {}
    with peer.spinning():
        # In parts, of which a page that lags drops nothing.
        for part in range(0, 40, 10):
            assert player.play(scans[part:part + 10]).lost == 0
            while round(1e-9 * scans[part + 9].stamp, 6) not in events:
                event = readers[0].next('scan')[1]
                events[round(event['time'], 6)] = event
    assert len(events) >= 20
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


def test_scans_of_several_lidars_are_drawn_where_their_own_parameters_place_them(start_command, watch, peer, scans,
                                                                                 tmp_path):
    """The mast has a 3D lidar, whose driver stamps 20 ms late; no lidar has a transform."""
    places = {'mast': SE2(0.2, -0.1), 'rear': SE2(-0.3, 0.1, 3.0)}
    file = tmp_path / 'lidars.yaml'
    file.write_text(f"""/**:
  ros__parameters:
    sensors: [mast, rear]
    mast: {{type: sensor_msgs/PointCloud2, laser_pose: {places['mast'].as_array().tolist()}, time_offset: [-0.02],
            height_min: -0.6}}
    rear.laser_pose: {places['rear'].as_array().tolist()}
""")
    start_command('scan_matcher', '--ros-args', '--params-file', str(file), '-r', '__ns:=/robot')
    process, port = watch('--ros-args', '-r', '__ns:=/robot')
    mast, rear = (Loudspeaker(peer, kind, f'/robot/{name}/scan')
                  for kind, name in ((PointCloud2, 'mast'), (LaserScan, 'rear')))
    reader = Reader('127.0.0.1', port)
    watched_from(reader, '/robot/scan_matcher')
    odometry = peer.listen(Odometry, '/robot/odom')
    peer.until(lambda: all(peer.node.count_subscribers(each.publisher.topic_name) == 2 for each in (mast, rear)))
    for number, scan in enumerate(scans[:24]):
        count = len(odometry)
        if number < ALIVE:
            mast.tell(cloud_of(dataclasses.replace(scan, stamp=scan.stamp + 20_000_000), tilted=False))
        rear.tell(scan_to_message(dataclasses.replace(scan, stamp=scan.stamp + 5_000_000)))
        # Two periods after the last scan of the mast there is odometry for those of the rear lidar.
        if not ALIVE <= number < ALIVE + 3:
            peer.until(lambda count=count: len(odometry) > count)
    placed = {round(message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec, 6): pose_of(message)
              for message in odometry}
    drawn = {'mast': 0, 'rear': 0}
    while not all(drawn.values()):
        event = reader.next('scan')[1]
        name = 'mast' if any(abs(event['time'] - 1e-9 * scan.stamp) < 1e-4 for scan in scans) else 'rear'
        np.testing.assert_allclose(event['pose'], (placed[round(event['time'], 6)] @ places[name]).as_array(),
                                   atol=1e-3)
        drawn[name] += 1
    reader.close()
    assert process.running()


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
