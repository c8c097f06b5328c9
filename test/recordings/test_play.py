# SPDX-License-Identifier: Apache-2.0
"""Playing to the real node in a process of its own, or to a subscriber of the test's."""
import gzip
import itertools
import sys
import time

import numpy as np
import pytest
import rclpy.qos
from bags import needs_rosbags
from ros_helpers import TIMEOUT
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan

from dbscan_reg_ros.__main__ import main
from dbscan_reg_ros.command_lines import command_line, split_arguments
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.playback.player import Player, PlayerError
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.recordings.playback import Schedule

SECOND = 1_000_000_000
RELIABLE = 1000


@pytest.fixture(scope='module')
def intel(data):
    """A stretch of the Intel log in which stamps go back."""
    return data / 'intel' / 'intel.log.gz'


@pytest.fixture(scope='module')
def scans(intel):
    return list(itertools.islice(open_recording(intel).scans(), 400))


def subscribe(peer, kind, topic, quality=RELIABLE):
    messages = []
    peer.node.create_subscription(kind, topic, messages.append, quality)
    return messages


# Schedule


@pytest.mark.parametrize('stamps, times', [
    ([5, 6, 8], [5, 6, 8]),
    ([5, 7, 6, 8], [5, 7, 7, 8]),
    ([5, 7, 4, 6, 9], [5, 7, 7, 7, 9]),
    ([50, 60, 10, 20], [50, 60, 60, 70]),
    ([50, 60, 50, 55], [50, 60, 60, 65]),
    ([100, 200, 0, 10, 0, 20], [100, 200, 200, 210, 210, 230]),
])
def test_a_schedule_never_goes_back_and_goes_on_after_a_new_start(stamps, times):
    schedule = Schedule()
    assert [schedule.time(s * SECOND) // SECOND for s in stamps] == times


# Player


def test_a_player_that_was_there_before_the_node_loses_no_scan(start_command, ros_environment, scans):
    with Player() as player:
        start_command('scan_matcher', '--ros-args', '-p', 'mounting:=none')
        player.wait_for_node(TIMEOUT)
        assert player.play(scans[:5]).lost == 0


def test_scans_that_are_not_answered_are_lost_and_a_node_that_has_gone_ends_the_play(node, ros_environment, scans):
    def then_stop():
        yield from scans[20:25]
        node.stop()
        yield from scans[25:40]

    empty = [type(s)(s.stamp, np.full(s.geometry.size, np.inf), s.geometry) for s in scans[10:12]]
    with Player() as player:
        player.wait_for_node(TIMEOUT)
        began = time.monotonic()
        answers = player.play([*scans[:10], *empty, *scans[12:20]], patience=100.0)
        assert time.monotonic() - began < 100.0, 'the patience of a scan that is not answered'
        with pytest.raises(PlayerError, match=r'has gone; it answered [1-5] of \d+ scans'):
            player.play(then_stop(), patience=0.5)
    assert [k for k, message in enumerate(answers.messages) if message is None] == [10, 11]
    assert answers.lost == 2
    assert np.isnan(answers.poses()[10:12]).all()
    assert np.isfinite(answers.poses()[12:]).all()


def test_scans_keep_the_timing_of_their_stamps_and_the_clock_never_goes_back(node, peer, scans):
    arrivals = []
    peer.node.create_subscription(LaserScan, 'scan', lambda m: arrivals.append((time.monotonic(), m)), RELIABLE)
    ticks = subscribe(peer, Clock, '/clock', rclpy.qos.QoSProfile(
        depth=RELIABLE, reliability=rclpy.qos.ReliabilityPolicy.BEST_EFFORT))
    some = scans[:40]
    assert any(a.stamp > b.stamp for a, b in itertools.pairwise(some)), 'stamps should go back in this stretch'
    schedule = Schedule()
    due = np.array([schedule.time(scan.stamp) for scan in some]) * 1e-9
    rate = (due[-1] - due[0]) / 2.0
    with peer.spinning(), Player(clock=True) as player:
        player.wait_for_node(TIMEOUT)
        answers = player.play(some, rate=rate)
    assert answers.stamps == [scan.stamp for scan in some]
    peer.until(lambda: len(arrivals) == 40)
    assert [in_nanoseconds(m.header.stamp) for _, m in arrivals] == answers.stamps
    late = np.array([t for t, _ in arrivals]) - due / rate
    assert np.median(late - late.min()) < 0.2, 'most scans come as long after their stamps as the most punctual one'
    clock = [in_nanoseconds(tick.clock) for tick in ticks]
    assert clock == sorted(clock)
    assert clock[-1] == round(due[-1] * 1e9) or clock[-1] == max(s.stamp for s in some)
    assert len(clock) > 60


# Command


@needs_rosbags
def test_the_command_plays_a_recording_on_remapped_topics_and_counts_the_answers(start_node, start_command, beginning):
    remapped = '-r', 'scan:=laser', '-r', 'odom:=laser_odom'
    start_node(*remapped)
    command = start_command('play', beginning / 'urg04lx' / 'exp1', '--lockstep', '--clock', '--ros-args', *remapped)
    assert command.wait(120.0) == 0, command.output()
    count = open_recording(beginning / 'urg04lx' / 'exp1').count
    assert command.output().splitlines()[-1] == f'scans {count} answered {count} skipped 0'


@pytest.mark.parametrize('words, complaint', [
    pytest.param(['missing.bag'], 'missing.bag', marks=needs_rosbags),
    (['setup.py', '--rate', 'fast'], "'fast': expected a number above 0"),
    (['setup.py', '--rate', '2', '--lockstep'], 'not allowed with'),
])
def test_a_wrong_command_line_ends_with_one_line(capsys, words, complaint):
    with pytest.raises(SystemExit) as ended:
        sys.exit(main(['play', *words]))
    assert ended.value.code == 2
    assert complaint in capsys.readouterr().err.splitlines()[-1]


def test_without_a_node_the_command_gives_up_in_time(start_command, intel):
    command = start_command('play', intel, '--wait', '0.5')
    assert command.wait(TIMEOUT) == 2
    assert command.output().strip() == ('play: no node subscribes to /scan after 0.5 s; start one: '
                                        + command_line('scan_matcher'))


def test_ros_arguments_are_separated_from_own_ones():
    words = ['a', '--ros-args', '-r', 'x:=y', '--', '-b', '--ros-args', '-p', 'c:=1']
    assert split_arguments(words) == (['a', '-b'], ['--ros-args', '-r', 'x:=y', '--', '--ros-args', '-p', 'c:=1'])
    assert split_arguments(['a']) == (['a'], [])


def test_playing_to_a_node_that_waits_for_transforms_says_what_to_do(start_command, intel, tmp_path):
    pytest.importorskip('tf2_msgs', reason='needs tf2_msgs (scripts/tf2_msgs/build.py)')
    recording = tmp_path / 'start.log'
    with gzip.open(intel, 'rt') as log:
        recording.write_text(''.join(itertools.islice(log, 500)))
    start_command('scan_matcher')
    process = start_command('play', recording, '--rate', '10000')
    assert process.wait(TIMEOUT) == 0
    assert "A recording without transforms needs a node with mounting 'none'" in process.output()
