# SPDX-License-Identifier: Apache-2.0
"""The node with a map: built and saved, read again, received from others; its frames, topics and services."""
import math
import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from ros_helpers import LATCHED, TIMEOUT, Loudspeaker, diagnosis, pose_of, said, transform
from std_msgs.msg import String
from std_srvs.srv import Empty, Trigger
from visualization_msgs.msg import MarkerArray

from dbscan_reg_ros import SE2, Map, Odometry, Parameters
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import pose_to_message, stamp_to_message
from dbscan_reg_ros.node.map.messages import grid_to_message
from dbscan_reg_ros.places.grid import Grid
from dbscan_reg_ros.places.mapper import Mapper
from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate

SECOND = 1_000_000_000
LASER = SE2(0.2, 0.05)
"""Pose of the laser on the base."""
MOUNTED = '-p', 'mounting:=laser_pose', '-p', f'laser_pose:=[{LASER.x}, {LASER.y}, 0.0]'


@pytest.fixture(scope='module')
def floor():
    """A floor: the scans of a tour and of another drive, and the true poses of the base in the map of the tour."""
    world = rooms(seed=2)
    tour, other = (simulate(world, follow(points, speed=0.8), Lidar(rate=rate), seed=1)
                   for points, rate in ((world.tour[:8], 2.0), (world.tour[6:2:-1], 4.0)))
    start = (SE2.from_array(tour.truth[0]) @ LASER.inverse()).inverse()
    truth = [start @ SE2.from_array(pose) @ LASER.inverse() for pose in other.truth]
    return SimpleNamespace(tour=tour.scans, scans=other.scans, truth=truth)


@pytest.fixture(scope='module')
def grid(floor):
    """The grid of the tour, as a map whose frame is that of the base at its first scan."""
    odometry, mapper = Odometry(), Mapper()
    for scan in floor.tour:
        mapper.process(odometry.process(scan))
    made = mapper.map()
    grid = Grid.of_map(made, Parameters())
    return Grid(grid.values[1:-1, 1:-1], LASER @ grid.origin, grid.resolution)


def off(pose, truth):
    """Errors [m], [deg] of a pose."""
    error = truth.inverse() @ pose
    return math.hypot(error.x, error.y), abs(math.degrees(error.theta))


def sent(messages, parent, child):
    """Stamp [ns] -> pose of the transforms between two frames among the messages on /tf."""
    found = {}
    for message in (each for batch in messages for each in batch.transforms):
        if (message.header.frame_id, message.child_frame_id) == (parent, child):
            t, q = message.transform.translation, message.transform.rotation
            found[in_nanoseconds(message.header.stamp)] = SE2(t.x, t.y, 2.0 * math.atan2(q.z, q.w))
    return found


def answered(player, scans):
    assert player.play(scans, patience=5.0).lost == 0
    return player.answers.messages


def test_a_map_that_was_built_and_saved_is_the_one_in_which_a_later_start_is_found(start_command, player, peer, floor,
                                                                                   tf_type, tmp_path):
    file = tmp_path / 'maps' / 'floor.npz'
    common = '--ros-args', *MOUNTED, '-p', f'map.file:={file}', '-p'
    node = start_command('scan_matcher', *common, 'map.mode:=slam')
    player.wait_for_node(TIMEOUT)
    tf, maps, graph = (peer.listen(kind, topic, quality) for kind, topic, quality in (
        (tf_type, '/tf', 1000), (OccupancyGrid, '/map', LATCHED), (MarkerArray, '/map_graph', LATCHED)))
    assert peer.call(Trigger, '/scan_matcher/save_map', Trigger.Request()).message == 'no scan was processed yet'
    with peer.spinning():
        answered(player, floor.tour)
    saved = peer.call(Trigger, '/scan_matcher/save_map', Trigger.Request())
    assert saved.success and saved.message == str(file)
    made = Map.load(file)
    assert made.mounting == LASER and made.poses[0] == pytest.approx(LASER.as_array())
    peer.until(lambda: maps and graph and len(graph[-1].markers[0].points) == len(made.views))
    assert maps[-1].header.frame_id == 'map'
    # Dated ahead, and hardly moved, as the odometry hardly drifts.
    corrections = sent(tf, 'map', 'odom')
    assert min(corrections) == floor.tour[0].stamp + SECOND // 2
    assert corrections[min(corrections)] == SE2()
    assert max(off(pose, SE2())[0] for pose in corrections.values()) < 0.1
    assert peer.call(Trigger, '/scan_matcher/reset', Trigger.Request()).success
    answered(player, floor.tour[:3])
    assert peer.call(Trigger, '/scan_matcher/save_map', Trigger.Request()).success
    peer.until(lambda: len(Map.load(file).views) == 1)
    made.save(file)
    assert node.stop() == 0

    start_command('scan_matcher', *common, 'map.mode:=localize')
    peer.until(lambda: not peer.node.get_publishers_info_by_topic('/map_graph'))
    player.wait_for_node(TIMEOUT)
    states = peer.listen(String, '/map_state', LATCHED)
    poses = peer.listen(PoseWithCovarianceStamped, '/pose')
    peer.until(lambda: [each.data for each in states] == ['searching'])
    peer.greet()
    with peer.spinning():
        answered(player, floor.scans)
    last = peer.until(lambda: poses and poses[-1].header.stamp == stamp_to_message(floor.scans[-1].stamp) and poses[-1])
    peer.until(lambda: states[-1].data == 'localised')
    metres, degrees = off(pose_of(last), floor.truth[-1])
    assert metres < 0.1 and degrees < 1.0 and last.header.frame_id == 'map'
    assert math.sqrt(last.pose.covariance[0]) < 0.2


def test_beside_another_odometry_in_a_map_that_is_received(start_command, player, peer, floor, grid, tf_type):
    """Its odometry begins elsewhere and drifts; the pose is set first, then searched."""
    node = start_command('scan_matcher', '--ros-args', *MOUNTED, '-p', 'publish_tf:=false', '-p', 'map.mode:=localize',
                         '-p', 'map.transform_tolerance:=0.1')
    drifting = {scan.stamp: SE2(5.0, -3.0, 1.0) @ floor.truth[0].inverse() @ pose @ SE2(theta=0.002 * k)
                for k, (scan, pose) in enumerate(zip(floor.scans, floor.truth, strict=True))}
    true = dict(zip(drifting, floor.truth, strict=True))
    theirs = Loudspeaker(peer, tf_type, '/tf', 1000)
    maps = Loudspeaker(peer, OccupancyGrid, '/map', LATCHED)
    given = Loudspeaker(peer, PoseWithCovarianceStamped, '/initialpose')
    tf, poses = peer.listen(tf_type, '/tf', 1000), peer.listen(PoseWithCovarianceStamped, '/pose')
    states = peer.listen(String, '/map_state', LATCHED)
    peer.until(lambda: [each.data for each in states] == ['waiting for a map'])
    maps.tell(grid_to_message(grid, 0, 'map'))
    said(node, 'cells of 0.05 m: searching', peer)
    theirs.tell(*(tf_type(transforms=[transform('odom', 'base_link', pose, stamp=stamp)])
                  for stamp, pose in drifting.items()))
    clicked = PoseWithCovarianceStamped()
    clicked.header.frame_id = 'map'
    clicked.pose.pose = pose_to_message(floor.truth[0] @ SE2(0.3, -0.3, 0.2))
    clicked.pose.covariance = np.diag([0.25, 0.25, 0.0, 0.0, 0.0, 0.07]).ravel()
    given.until(lambda: 'pose in the map set on initialpose' in node.output(), clicked)
    player.wait_for_node(TIMEOUT)
    peer.greet()
    with peer.spinning():
        answered(player, floor.scans[:20])
    peer.until(lambda: poses and poses[-1].header.stamp.sec and states[-1].data == 'localised')
    assert off(pose_of(poses[0]), floor.truth[0] @ SE2(0.3, -0.3, 0.2))[0] < 0.05 or len(poses) < 20
    assert peer.call(Empty, '/reinitialize_global_localization', Empty.Request()) is not None
    with peer.spinning():
        answered(player, floor.scans[20:])
    said(node, 'reinitialize_global_localization was called: searching the map', peer)
    peer.until(lambda: in_nanoseconds(poses[-1].header.stamp) > floor.scans[20].stamp
               and states[-1].data == 'localised')
    answered(player, floor.scans[-1:])
    corrections = peer.until(lambda: sent(tf, 'map', 'odom'))
    stamp = max(corrections) - SECOND // 10
    metres, degrees = off(corrections[stamp + SECOND // 10] @ drifting[stamp], true[stamp])
    assert metres < 0.1 and degrees < 1.0
    assert not sent(tf, 'odom', 'base_link').keys() - drifting.keys()
    statuses = peer.listen(DiagnosticArray, '/diagnostics')
    theirs.tell(tf_type(transforms=[transform('elsewhere', 'odom')]))
    assert diagnosis(peer, statuses, lambda s: "to 'odom' too, from 'elsewhere'" in s.message
                     and s.level == DiagnosticStatus.ERROR)


def test_ctrl_c_while_a_map_is_written_loses_nothing(start_command, player, peer, floor, tmp_path):
    file = tmp_path / 'floor.npz'
    node = start_command('scan_matcher', '--ros-args', *MOUNTED, '-p', 'map.mode:=slam', '-p', f'map.file:={file}')
    player.wait_for_node(TIMEOUT)
    answered(player, floor.tour[:40])
    client = peer.node.create_client(Trigger, '/scan_matcher/save_map')
    peer.until(client.service_is_ready)
    peer.greet()
    client.call_async(Trigger.Request())
    said(node, 'writing the map to', peer)
    node.signal(signal.SIGINT)
    assert node.wait(TIMEOUT) == 0
    assert len(Map.load(file).views) > 5 and [path.name for path in tmp_path.glob('floor*')] == ['floor.npz']
    assert 'Traceback' not in node.output()


def test_without_a_map_neither_it_nor_the_slow_libraries_are_imported(ros_environment):
    program = ("import sys, rclpy; from rclpy.node import Node; rclpy.init(); "
               "from dbscan_reg_ros.node.interfaces.live_parameters import LiveParameters; "
               "from dbscan_reg_ros.node.node_core import NodeCore; "
               "node = Node('scan_matcher', automatically_declare_parameters_from_overrides=True); "
               "NodeCore(node, LiveParameters(node)).activate(); "
               "print(sorted(name for name in sys.modules if 'places' in name or 'node.map' in name "
               "or name in ('sklearn', 'matplotlib', 'rosbags', 'tqdm'))); "
               "rclpy.shutdown()")
    done = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True, timeout=3 * TIMEOUT)
    assert done.stdout.strip() == '[]', done.stderr
