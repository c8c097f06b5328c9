# SPDX-License-Identifier: Apache-2.0
"""What goes wrong on a robot, done to the real node while it drives: it goes on at once, and nothing jumps.

Each fault strikes at one moment, with ``scripts/test --long`` at twenty.
"""
import contextlib
import itertools
import os
import signal
from pathlib import Path

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from bags import needs_rosbags, scan_bag
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from rcl_interfaces.srv import SetParameters
from ros_helpers import (
    TIMEOUT,
    Loudspeaker,
    Peer,
    needs_tf2_msgs,
    parameter_messages,
    said,
    transform,
)
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import stamp_to_message
from dbscan_reg_ros.node.playback.player import PlayerError

RESUMED, RESTARTED = 1.0, 5.0
"""There is odometry so long [s] after the first good scan, and after a process is started again."""
@pytest.fixture
def parts(scans, moment):
    """The scans before the moment, and those after it."""
    return scans[:moment], scans[moment:]


@pytest.fixture(autouse=True)
def nothing_left_behind(ros_environment, tmp_path):
    """No process of the test outlives it."""
    yield
    assert not [path for path in Path('/proc').glob('[0-9]*/environ') if str(tmp_path / 'ros_log') in content(path)]


def content(path):
    with contextlib.suppress(OSError):
        return path.read_text(errors='replace')
    return ''


@pytest.fixture
def start_node(start_node):
    """As everywhere; but each node that still runs in the end has to stop at a signal, and none leaves a traceback."""
    nodes = []

    def start(*words, **environment):
        nodes.append(start_node(*words, **environment))
        return nodes[-1]

    yield start
    for node in nodes:
        assert not node.running() or node.stop() == 0, node.output()
        assert 'Traceback' not in node.output()


def begun(player, scans):
    """Answers to all scans up to the fault."""
    player.wait_for_node(TIMEOUT)
    answers = player.play(scans)
    assert answers.lost == 0
    return answers.messages


def resumed(player, scans):
    """Answers to the good scans after the fault, the first of them in time."""
    first = player.play(scans[:1], patience=RESUMED)
    rest = player.play(scans[1:])
    assert (first.lost, rest.lost) == (0, 0)
    return [*first.messages, *rest.messages]


# Scans


@pytest.mark.long
def test_scans_come_in_a_burst_after_a_pause(node, player, scans, moment, steady):
    before = begun(player, scans[:moment])
    burst = player.play(scans[moment:moment + 20], window=20).messages
    steady([*before, *filter(None, burst), *resumed(player, scans[moment + 20:])])


@pytest.mark.usefixtures('node')
def test_the_publisher_is_killed_and_started_again(start_command, peer, scans, moment, steady, tmp_path):
    answers = peer.listen(Odometry, 'odom')
    first = start_command('play', scan_bag(tmp_path / 'all', scans), '--rate', '2')
    peer.until(lambda: answers and in_nanoseconds(answers[-1].header.stamp) >= scans[moment].stamp)
    killed(first)
    before, last = len(answers), in_nanoseconds(answers[-1].header.stamp)
    rest = [scan for scan in scans if scan.stamp > last][15:]
    start_command('play', scan_bag(tmp_path / 'rest', rest), '--rate', '2')
    peer.until(lambda: len(answers) > before, RESTARTED)
    peer.until(lambda: answers[-1].header.stamp == stamp_to_message(scans[-1].stamp))
    steady(answers)


# The node, and those who talk to it


def killed(process):
    os.killpg(process.pid, signal.SIGKILL)
    process.wait(TIMEOUT)


def test_the_node_is_killed_and_started_again(start_node, player, peer, scans, moment, steady):
    node = start_node()
    before = begun(player, scans[:moment])
    killed(node)
    start_node()
    first = peer.until(lambda: answered(player, scans[moment]), RESTARTED)
    steady(before)
    steady([first, *begun(player, scans[moment + 1:])])


def answered(player, scan):
    """The answer to a scan, None when there is none yet."""
    with contextlib.suppress(PlayerError):
        return player.play([scan], patience=0.1).messages[0]


@pytest.mark.long
def test_parameters_are_set_a_hundred_times_a_second(node, player, peer, scans, moment, steady):
    client = peer.node.create_client(SetParameters, '/scan_matcher/set_parameters')
    before = begun(player, scans[:moment])
    peer.greet()
    values = itertools.cycle([28.0, 29.0])
    asked = []

    def ask():
        request = SetParameters.Request(parameters=parameter_messages({'scan.range_max': next(values)}))
        asked.append(client.call_async(request))

    timer = peer.node.create_timer(0.01, ask)
    with peer.spinning():
        answers = player.play(scans[moment:], rate=1.0).messages
    timer.cancel()
    peer.until(lambda: any(future.done() for future in asked[-10:]))
    results = [future.result().results[0] for future in asked if future.done()]
    assert all(result.successful for result in results)
    assert len(asked) > 5 * len(answers)
    assert len(results) > 0.25 * len(asked), 'a service keeps ten requests at most, but not so few'
    assert any(answers[:10])
    steady([*before, *filter(None, answers)])


@pytest.mark.long
@needs_rosbags
@pytest.mark.usefixtures('node')
def test_subscribers_never_read(data, player, peer, start_command, parts, steady):
    """One is stopped as a process, one never takes what has arrived."""
    stopped = start_command('play', str(data / 'lms511' / 'static'), '--wait', '1000', '--ros-args', '-r',
                            'scan:=elsewhere')
    with Peer('deaf') as deaf:
        for kind, topic in ((Odometry, 'odom'), (MarkerArray, 'segments'), (PathMessage, 'path'),
                            (PointCloud2, 'local_map')):
            deaf.node.create_subscription(kind, topic, print, 10)
        peer.until(lambda: peer.node.count_subscribers('/odom') == 3)
        before = begun(player, parts[0])
        stopped.signal(signal.SIGSTOP)
        answers = [*before, *resumed(player, parts[1])]
        backwards = [*parts[0], *parts[1]][::-1]
        again = [resumed(player, backwards[k:k + 40]) for k in (0, 40)]
        killed(stopped)
        steady([*answers, *itertools.chain(*again)])


# Time and transforms


@pytest.mark.long
def test_the_clock_steps_back_and_forth(start_node, player, peer, scans, moment, steady):
    start_node('-p', 'use_sim_time:=true')
    clock = Loudspeaker(peer, Clock, '/clock', 1).publisher
    rng = np.random.default_rng(moment)

    def stepping():
        for scan in scans[moment:]:
            clock.publish(Clock(clock=stamp_to_message(scan.stamp + int(rng.integers(-10**9, 10**9)))))
            yield scan

    before = begun(player, scans[:moment])
    answers = player.play(stepping(), patience=RESUMED)
    assert answers.lost == 0
    steady([*before, *answers.messages])


@pytest.mark.long
@needs_tf2_msgs
def test_the_transform_of_the_laser_vanishes(start_node, player, peer, scans, moment, steady):
    from tf2_msgs.msg import TFMessage
    node = start_node('-p', 'mounting:=tf', '-p', 'advanced.input.max_wait:=0.5')
    player.wait_for_node(TIMEOUT)
    Loudspeaker(peer, TFMessage, '/tf').tell(
        TFMessage(transforms=[transform('base_link', 'laser', stamp=s.stamp) for s in scans[:moment]]))
    before = begun(player, scans[:moment])
    answers = player.play(scans[moment:], patience=RESUMED)
    assert answers.lost == 0
    assert max(answers.delays[5:]) < 0.5
    said(node, "the transform from 'base_link' to 'laser' is not known at the time of the scan", peer)
    steady([*before, *answers.messages])


# Files
