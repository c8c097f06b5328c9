# SPDX-License-Identifier: Apache-2.0
"""Faults that other laser odometries were reported to have, each tried on the real node in a process of its own."""
import array
import contextlib
import itertools
import math

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from ros_helpers import (
    TIMEOUT,
    Loudspeaker,
    changed,
    distances,
    inverted,
    mounted,
    of_base,
    played,
    pose_of,
)
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger

from dbscan_reg_ros import SE2, Scan
from dbscan_reg_ros.node.interfaces.messages import scan_to_message
from dbscan_reg_ros.node.playback.player import Player
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.simulation import Lidar, follow, measure, rooms, simulate

START = 1_700_000_000 * 10**9

AHEAD = SE2(0.3, -0.1, 0.0)


def test_covariances_are_never_zero_and_grow_with_the_path(node, player, scans):
    answers = played(player, scans)
    for kind in ('pose', 'twist'):
        planar = [np.reshape(getattr(m, kind).covariance, (6, 6))[np.ix_([0, 1, 5], [0, 1, 5])]
                  for m in answers.messages]
        assert all(np.linalg.eigvalsh(matrix)[0] > 0.0 for matrix in planar)
    traces = [np.trace(np.reshape(m.pose.covariance, (6, 6))[:2, :2]) for m in answers.messages]
    assert traces[-1] > traces[1]


def test_the_twist_is_in_the_frame_of_the_base(start_node, player, scans, truth):
    """The laser looks to the left and sits ahead: its own velocity is quite another."""
    laser = SE2(0.3, 0.0, math.pi / 2.0)
    start_node(*mounted(laser))
    answers = played(player, scans)
    bases = of_base(truth, laser)
    expected = [(a.inverse() @ b).as_array() / 0.1 for a, b in itertools.pairwise(bases)]
    reported = [(t.linear.x, t.linear.y, t.angular.z) for t in (m.twist.twist for m in answers.messages[1:])]
    assert (np.abs(np.subtract(reported, expected)).mean(axis=0) < 0.12).all()
    assert (np.linalg.norm(expected, axis=1)).max() > 0.5


def test_the_twist_does_not_depend_on_how_fast_the_scans_come(start_node, player, peer, scans):
    start_node('-p', 'input.queue_size:=50')
    slow = played(player, scans[:20], rate=1.0)
    assert peer.call(Trigger, '/scan_matcher/reset', Trigger.Request()).success
    fast = player.play(scans[:20], rate=20.0)
    assert slow.lost == fast.lost == 0
    assert [message.twist for message in fast.messages] == [message.twist for message in slow.messages]


def test_a_sideways_motion_is_seen_in_linear_y(start_node, player, scans, truth):
    start_node(*mounted(SE2(0.0, 0.0, -math.pi / 2.0)))
    answers = played(player, scans)
    sideways = [abs(m.twist.twist.linear.y) for m in answers.messages[1:]]
    forward = [math.hypot(b.x - a.x, b.y - a.y) / 0.1 for a, b in itertools.pairwise(truth)]
    assert max(sideways) == pytest.approx(max(forward), rel=0.2)


def test_beams_of_nan_and_inf_do_not_matter(node, player, scans, truth):
    rng = np.random.default_rng(2)
    spoilt = []
    for scan in scans[:40]:
        ranges = scan.ranges.copy()
        for value in (math.nan, math.inf, -math.inf, 0.0, -1.0, 1e9):
            ranges[rng.choice(len(ranges), 20, replace=False)] = value
        spoilt.append(Scan(scan.stamp, ranges, scan.geometry, 0.0, 'laser'))
    answers = played(player, spoilt)
    assert answers.lost == 0
    assert distances(answers.messages, truth[:40]).max() < 0.06
    assert all(np.isfinite(m.pose.covariance).all() and np.isfinite(m.twist.covariance).all() for m in answers.messages)


def test_a_beam_count_that_changes_between_scans_does_not_matter(node, player, scans, truth):
    rng = np.random.default_rng(3)
    cut = [type(s).from_message(changed(s, beams=int(rng.integers(330, 361)))) for s in scans[:40]]
    answers = played(player, cut)
    assert answers.lost == 0
    assert distances(answers.messages, truth[:40]).max() < 0.06


def test_a_driver_that_drops_most_of_its_scans_is_followed(node, player, scans, truth):
    kept = [k for k in range(80) if k % 5 in (0, 3)]
    answers = played(player, [scans[k] for k in kept])
    assert answers.lost == 0
    assert distances(answers.messages, [truth[k] for k in kept]).max() < 0.08


def clockwise(scan):
    """The same beams counted the other way round, as a clockwise lidar does."""
    message = scan_to_message(scan)
    message.angle_min, message.angle_max = message.angle_max, message.angle_min
    message.angle_increment = -message.angle_increment
    message.ranges = array.array('f', message.ranges[::-1])
    return type(scan).from_message(message)


def test_a_clockwise_lidar_gives_the_same_trajectory(node, player, scans, truth):
    answers = played(player, [clockwise(scan) for scan in scans])
    assert answers.lost == 0
    assert distances(answers.messages, truth).max() < 0.06


@pytest.fixture(params=['simulated', 'intel'])
def recorded(request):
    """Scans of a robot that drives about."""
    if request.param == 'simulated':
        return request.getfixturevalue('scans')
    folder = request.getfixturevalue('data')
    return list(itertools.islice(open_recording(folder / 'intel' / 'intel.log.gz').scans(), 300))


def test_an_upside_down_lidar_turned_round_and_ahead_gives_the_trajectory_of_the_base(start_node, player, recorded):
    """Nothing is left out as moving: at that margin rounding decides.

    So it does which old points belong to the local map, and a pose differs by millimetres.
    """
    alike = '-p', 'advanced.odometry.dynamic_key_frames:=0'
    plain = start_node(*mounted(AHEAD), *alike)
    expected = played(player, recorded)
    plain.stop()
    start_node(*mounted(SE2(AHEAD.x, AHEAD.y, math.pi)), '-p', 'upside_down:=true', *alike)
    with Player() as second:
        answers = played(second, list(inverted(recorded)))
    assert expected.lost == answers.lost == 0
    assert distances(answers.messages, [pose_of(m) for m in expected.messages]).max() < 0.01


def test_a_lidar_mounted_backwards_gives_the_trajectory_of_the_base(start_node, player, scans, truth):
    turned = SE2(0.3, 0.0, math.pi)
    start_node(*mounted(turned))
    back = []
    for scan in scans:
        message = scan_to_message(scan)
        message.angle_min, message.angle_max = message.angle_min + math.pi, message.angle_max + math.pi
        back.append(type(scan).from_message(message))
    answers = played(player, back)
    assert answers.lost == 0
    assert distances(answers.messages, of_base(truth, SE2(0.3, 0.0, 0.0))).max() < 0.06


def test_a_field_of_view_to_one_side_does_not_matter(start_node, player):
    """A lidar of 240 deg that begins straight ahead; it is mounted so that it looks all round but to the right."""
    world = rooms(seed=1)
    laser = SE2(0.1, 0.0, -0.5)
    lidar = Lidar(beams=240, angle_min=0.0, mounting=laser)
    drive = simulate(world, follow(world.tour[:3], speed=1.0), lidar, seed=2)
    start_node(*mounted(laser))
    answers = played(player, drive.scans[:60])
    assert answers.lost == 0
    start = (SE2.from_array(drive.truth[0]) @ laser.inverse()).inverse()
    bases = [start @ SE2.from_array(pose) @ laser.inverse() for pose in drive.truth[:60]]
    assert distances(answers.messages, bases).max() < 0.08


def test_the_result_is_that_of_the_base_and_not_of_the_laser(start_node, player, scans, truth):
    laser = SE2(1.0, 0.5, 0.3)
    start_node(*mounted(laser))
    answers = played(player, scans)
    assert {m.child_frame_id for m in answers.messages} == {'base_link'}
    assert distances(answers.messages, of_base(truth, laser)).max() < 0.1
    assert distances(answers.messages, truth).max() > 0.3


@pytest.mark.parametrize('reliability', [ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE])
def test_scans_are_received_with_any_qos_of_their_publisher(node, peer, scans, reliability):
    answers = peer.listen(Odometry, 'odom')
    speaker = Loudspeaker(peer, LaserScan, 'scan', QoSProfile(depth=5, reliability=reliability))
    assert speaker.until(lambda: answers, scan_to_message(scans[0]))


@pytest.mark.parametrize('beams', [180, 720])
def test_a_robot_at_rest_does_not_drift(node, player, drive, beams):
    rng = np.random.default_rng(3)
    lidar = Lidar(beams=beams, angle_min=-0.75 * math.pi, angle_increment=1.5 * math.pi / beams, noise=0.02)
    place = drive.path.poses_at(np.array([2.0]))
    still = [measure(drive.world, place, lidar, rng, scan_stamp) for scan_stamp in START + 40_000_000 * np.arange(300)]
    answers = played(player, still)
    assert answers.lost == 0
    assert distances(answers.messages, [SE2()] * len(still))[-1] < 0.01
    assert abs(pose_of(answers.messages[-1]).theta) < 0.003


def test_robots_in_one_graph_do_not_touch_each_other(start_node, peer, scans, truth):
    names = ['/left', '/right']
    for name in names:
        start_node('-r', f'__ns:={name}', '-r', '/tf:=tf', '-r', '/tf_static:=tf_static')
    with contextlib.ExitStack() as stack:
        players = [stack.enter_context(Player(['--ros-args', '-r', f'__ns:={name}'])) for name in names]
        for player in players:
            player.wait_for_node(TIMEOUT)
        for begin, player in zip((0, 30), players, strict=True):
            answers = player.play(scans[begin:begin + 20])
            assert (answers.lost, answers.unexpected) == (0, 0)
            back = truth[begin].inverse()
            assert distances(answers.messages, [back @ pose for pose in truth[begin:begin + 20]]).max() < 0.05
        assert peer.call(Trigger, '/left/scan_matcher/reset', Trigger.Request()).success
        [left] = players[0].play(scans[20:21]).messages
        [right] = players[1].play(scans[50:51]).messages
        assert pose_of(left) == SE2()
        assert math.hypot(*pose_of(right).as_array()[:2]) > 0.1
    assert not peer.node.count_publishers('/odom')
