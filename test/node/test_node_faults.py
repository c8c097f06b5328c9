# SPDX-License-Identifier: Apache-2.0
"""What goes wrong on a robot, done to the real node while it drives: it goes on at once, and nothing jumps.

Each fault strikes at one moment, with ``scripts/test --long`` at twenty.
"""
import contextlib
import itertools
import os
import shutil
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
    pose_of,
    said,
    transform,
)
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from dbscan_reg_ros.commands.processes import package_command
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import stamp_to_message
from dbscan_reg_ros.node.playback.player import PlayerError

LIMIT = 16.3
"""One true motion in a thousand is farther off than this, as a squared Mahalanobis distance."""
RESUMED, RESTARTED = 1.0, 5.0
"""There is odometry so long [s] after the first good scan, and after a process is started again."""
FULL = '64k'
"""Room on a disk that is soon full."""


def pytest_generate_tests(metafunc):
    if 'moment' in metafunc.fixturenames:
        count = 20 if metafunc.config.getoption('long') else 1
        metafunc.parametrize('moment', np.random.default_rng(8).integers(10, 50, count).tolist())


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


@pytest.fixture
def steady(scans, truth):
    """``steady(messages)``: no motion between two answers is farther from the true one than their covariance allows."""
    true = {scan.stamp: pose for scan, pose in zip(scans, truth, strict=True)}

    def steady(messages):
        poses = [true[in_nanoseconds(message.header.stamp)] for message in messages]
        for (before, after), (p, q) in zip(itertools.pairwise(messages), itertools.pairwise(poses), strict=True):
            assert distance(before, after, p.inverse() @ q) < LIMIT
        assert len(messages) > 10

    return steady


def distance(before, after, motion):
    """Squared Mahalanobis distance of the motion between two messages from the true one, by the later's covariance."""
    error = (motion.inverse() @ pose_of(before).inverse() @ pose_of(after)).as_array()
    turn = np.eye(3)
    turn[:2, :2] = pose_of(after).rotation()
    covariance = np.reshape(after.pose.covariance, (6, 6))[np.ix_([0, 1, 5], [0, 1, 5])]
    return error @ np.linalg.solve(turn.T @ covariance @ turn, error)


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


def lost(scans, moment, rng):
    return list(itertools.compress(scans, (rng.random(len(scans)) < 0.5) | (np.arange(len(scans)) < moment)))


def twice_and_three_times(scans, moment, rng):
    times = rng.integers(1, 4, len(scans))
    return [scan for k, scan in enumerate(scans) for _ in range(times[k] if k > moment else 1)]


def overtaking(scans, moment, rng):
    later = [k for start in range(moment, len(scans), 3) for k in rng.permutation(range(len(scans))[start:start + 3])]
    return [*scans[:moment], *(scans[k] for k in later)]


@pytest.mark.parametrize('disorder', [lost, *(pytest.param(each, marks=pytest.mark.long)
                                              for each in (twice_and_three_times, overtaking))])
def test_scans_are_lost_come_again_or_overtake_each_other(node, player, scans, moment, steady, disorder):
    steady(begun(player, disorder(scans, moment, np.random.default_rng(moment))))


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


@pytest.fixture
def full_disk(tmp_path):
    """A folder, and the words before a command that see a disk of 64 kB mounted there."""
    folder = tmp_path / 'full'
    folder.mkdir()
    words = ['unshare', '--mount', '--map-root-user', 'sh', '-c',
             f'mount -t tmpfs -o size={FULL} none {folder} && exec "$@"', 'sh']
    if not shutil.which('unshare') or os.system(' '.join(map(repr, [*words, 'true']))):
        pytest.skip('needs unshare, and to be allowed to mount')
    return folder, words


def snapshot(peer):
    return peer.call(Trigger, '/scan_matcher/snapshot', Trigger.Request())


def test_the_disk_is_full_while_a_snapshot_is_written(start, player, peer, parts, steady, full_disk):
    folder, words = full_disk
    node = start(*words, *package_command('scan_matcher', '--ros-args', '-p', 'mounting:=none', '-p',
                                          'advanced.snapshot.scans:=100',
                                          '-p', f'advanced.snapshot.folder:={folder}'))
    before = begun(player, parts[0])
    for _ in range(3):
        answer = snapshot(peer)
        if not answer.success:
            break
    assert 'cannot be written: No space left on device' in answer.message
    seen = Path(f'/proc/{node.pid}/root{folder}')
    assert not [path for path in seen.iterdir() if path.suffix != '.npz']
    steady([*before, *resumed(player, parts[1])])
    assert node.stop() == 0
    assert 'Traceback' not in node.output()


def test_the_disk_is_full_while_a_replay_is_written(start, scans, full_disk, tmp_path):
    folder, words = full_disk
    process = start(*words, *package_command('replay', scan_bag(tmp_path / 'drive', scans), '--out', folder))
    assert process.wait(TIMEOUT) == 3, process.output()
    faults = [line for line in process.output().splitlines() if ' not written: ' in line]
    assert faults and all(line.endswith(' not written: No space left on device') for line in faults), process.output()
    assert 'ok 80' in process.output() and 'Traceback' not in process.output()


def test_the_folder_of_logs_is_read_only(start_command):
    node = start_command('scan_matcher', ROS_LOG_DIR='/sys/log')
    assert node.wait(TIMEOUT) == 2
    assert 'scan_matcher: ROS does not start: ' in node.output() and "'/sys/log'" in node.output()
    assert len(node.output().strip().splitlines()) == 1


@pytest.mark.long
def test_the_folder_of_snapshots_is_read_only(start_node, player, peer, scans, moment, steady):
    start_node('-p', 'advanced.snapshot.folder:=/sys')
    before = begun(player, scans[:moment])
    answer = snapshot(peer)
    assert not answer.success
    assert '/sys/scan_matcher_' in answer.message and 'cannot be written: ' in answer.message
    steady([*before, *resumed(player, scans[moment:])])


def test_the_folder_of_results_is_read_only(start_command, scans, tmp_path):
    process = start_command('replay', scan_bag(tmp_path / 'drive', scans[:5]), '--out', '/sys')
    assert process.wait(TIMEOUT) == 2, process.output()
    assert process.output().startswith('replay: /sys: cannot be written, ')
    assert len(process.output().strip().splitlines()) == 1
