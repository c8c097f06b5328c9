# SPDX-License-Identifier: Apache-2.0
"""Time: simulated, in a loop, going back, at zero, in the future."""
import dataclasses
import math

import numpy as np
import pytest
import rclpy  # noqa: F401 - needs ROS
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from ros_helpers import TIMEOUT, Loudspeaker, changed, diagnosis, distances, played, pose_of, restamped, said
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan
from std_srvs.srv import SetBool, Trigger

from dbscan_reg_ros import SE2
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import stamp_to_message
from dbscan_reg_ros.node.playback.player import Player

SECOND = 1_000_000_000


def test_with_simulated_time_every_scan_is_answered_with_its_stamp(start_node, scans, truth):
    start_node('-p', 'use_sim_time:=true')
    with Player(clock=True) as player:
        player.wait_for_node(TIMEOUT)
        answers = player.play(scans[:30], rate=2.0)
    assert answers.lost == 0
    assert [in_nanoseconds(m.header.stamp) for m in answers.messages] == [scan.stamp for scan in scans[:30]]
    assert distances(answers.messages, truth[:30]).max() < 0.05


def test_scans_are_answered_while_simulated_time_is_constant(start_node, player, peer, scans):
    start_node('-p', 'use_sim_time:=true')
    received = peer.listen(DiagnosticArray, '/diagnostics')
    assert played(player, scans[:5]).lost == 0
    assert diagnosis(peer, received, lambda s: s.message == 'tracking')


def test_between_scans_odom_and_transform_are_predicted(start_node, player, peer, scans):
    """Stamps of odom increase, every scan has its transform, and nothing is sent after `coast_time` or in a pause."""
    tf_type = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs (scripts/tf2_msgs/build.py)').TFMessage
    start_node('-p', 'use_sim_time:=true', '-p', 'publish_rate:=50.0')
    odom, transforms = peer.subscribe(Odometry, '/odom'), peer.subscribe(tf_type, '/tf')
    clock = Loudspeaker(peer, Clock, '/clock')
    assert played(player, scans[:20]).lost == 0

    def at(stamp):
        clock.tell(Clock(clock=stamp_to_message(stamp)))
        peer.greet()

    peer.until(lambda: len(odom) == 20)
    last = pose_of(odom[-1])
    for ahead in (40, 80, 150, 900, 1100, 1200):
        at(scans[19].stamp + ahead * SECOND // 1000)
    stamps = [in_nanoseconds(message.header.stamp) - scans[19].stamp for message in odom[20:]]
    assert [stamp // 1_000_000 for stamp in stamps] == [40, 80, 150, 900]
    velocity = odom[19].twist.twist.linear
    assert math.hypot(pose_of(odom[21]).x - last.x, pose_of(odom[21]).y - last.y) == pytest.approx(
        0.08 * math.hypot(velocity.x, velocity.y), rel=1e-3)
    assert odom[22].pose.covariance[0] > odom[20].pose.covariance[0] > odom[19].pose.covariance[0]
    player.play(scans[20:30], patience=0.3)
    sent = peer.until(lambda: len(transforms) >= 34 and transforms)
    assert {scan.stamp for scan in scans[:30]} <= {in_nanoseconds(m.transforms[0].header.stamp) for m in sent}
    stamps = [in_nanoseconds(message.header.stamp) for message in odom]
    assert stamps == sorted(set(stamps))
    assert peer.call(SetBool, '/scan_matcher/pause', SetBool.Request(data=True)).success
    count = len(transforms)
    at(scans[29].stamp + 20_000_000)
    assert len(transforms) == count


def test_a_rate_that_has_no_effect_is_named(start_node, player, peer, scans):
    """Scans of long ago, without simulated time."""
    node = start_node('-p', 'publish_rate:=50.0')
    assert played(player, scans[:3]).lost == 0
    said(node, 'publish_rate has no effect: the last scan is ', peer)


def test_a_looped_bag_restarts_the_odometry_with_each_loop(node, player, peer, scans, truth):
    """Stamps that go back by seconds are a recording that starts again."""
    tf_type = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs (scripts/tf2_msgs/build.py)').TFMessage
    player.wait_for_node(TIMEOUT)
    received = peer.subscribe(tf_type, '/tf')
    for _ in range(2):
        answers = player.play(scans[:50])
        assert answers.lost == 0
        assert pose_of(answers.messages[0]) == SE2()
        assert distances(answers.messages, truth[:50]).max() < 0.05
    said(node, 'odometry reset: the stamps of the scans start again', peer)
    assert 'tracking restarted' not in node.output()
    peer.until(lambda: len(received) == 100)


@pytest.mark.parametrize('seed', [0])
def test_a_scan_of_somewhere_else_after_a_jump_restarts_the_tracking_and_keeps_the_pose(node, player, peer, scans,
                                                                                        truth, seed):
    """The log has another word for it than for a reset, after which the pose is the origin."""
    before = played(player, scans[:30])
    assert before.lost == 0
    elsewhere, = restamped(scans[29:30], [scans[29].stamp + 100 * SECOND])
    ranges = np.random.default_rng(seed).uniform(1.0, 9.0, len(elsewhere.ranges))
    answers = player.play([dataclasses.replace(elsewhere, ranges=ranges)])
    assert answers.lost == 0
    last, kept = pose_of(before.messages[-1]), pose_of(answers.messages[0])
    assert kept.as_array() == pytest.approx(last.as_array(), abs=1e-6)
    assert math.hypot(kept.x, kept.y) > 1.0 and distances(answers.messages, truth[29:30]).max() < 0.05
    said(node, 'tracking restarted at the last pose: ', peer)
    assert 'odometry reset' not in node.output()


def test_a_clock_that_goes_far_back_resets_the_odometry(start_node, player, peer, scans):
    node = start_node('-p', 'use_sim_time:=true')
    player.wait_for_node(TIMEOUT)
    received = peer.listen(DiagnosticArray, '/diagnostics')
    clock = Loudspeaker(peer, Clock, '/clock', 1)
    ahead, back = (Clock(clock=stamp_to_message(scans[k].stamp)) for k in (40, 15))
    assert player.play(scans[15:20]).lost == 0
    clock.until(lambda: received and received[-1].header.stamp == ahead.clock, ahead)
    clock.until(lambda: 'the clock went back by 2.5 s' in node.output(), back)
    assert pose_of(player.play(scans[20:21]).messages[0]) == SE2()


@pytest.mark.parametrize('back', [1000])
def test_a_single_scan_far_back_in_time_is_skipped_with_the_reason(node, player, peer, scans, truth, back):
    wrong = restamped(scans[30:31], [scans[30].stamp - back * SECOND])
    answers = played(player, [*scans[:30], *wrong, *scans[31:40]])
    assert [k for k, message in enumerate(answers.messages) if message is None] == [30]
    assert distances(answers.messages[31:], truth[31:40]).max() < 0.05
    said(node, 'scan skipped: its stamp lies far before those of the scans around it', peer)
    assert 'odometry reset' not in node.output()


@pytest.mark.long
def test_a_scan_far_back_in_time_is_forgotten_by_a_reset_and_not_by_a_pause(node, player, peer, scans, truth):
    assert played(player, scans[40:60]).lost == 0
    assert player.play(scans[:1], patience=0.5).lost == 1
    for value in (True, False):
        assert peer.call(SetBool, '/scan_matcher/pause', SetBool.Request(data=value)).success
    answers = player.play(scans[1:20])
    assert (answers.lost, answers.unexpected) == (0, 1)
    assert distances(answers.messages, truth[1:20]).max() < 0.05
    late = restamped(scans[20:30], [scan.stamp - 1000 * SECOND for scan in scans[20:30]])
    assert player.play(late[:1], patience=0.5).lost == 1
    assert peer.call(Trigger, '/scan_matcher/reset', Trigger.Request()).success
    answers = player.play(late[1:])
    assert (answers.lost, answers.unexpected) == (0, 0)
    assert pose_of(answers.messages[0]) == SE2()


@pytest.mark.long
def test_a_clock_that_goes_back_after_the_first_scan_of_a_loop_takes_nothing_from_it(start_node, player, peer, scans,
                                                                                     truth):
    node = start_node('-p', 'use_sim_time:=true')
    player.wait_for_node(TIMEOUT)
    clock = Loudspeaker(peer, Clock, '/clock', 1)
    received = peer.listen(DiagnosticArray, '/diagnostics')
    now = Clock(clock=stamp_to_message(scans[59].stamp))
    clock.until(lambda: received and received[-1].header.stamp == now.clock, now)
    assert player.play(scans[40:60]).lost == 0
    assert player.play(scans[:1], patience=0.5).lost == 1
    clock.until(lambda: 'the clock went back' in node.output(), Clock(clock=stamp_to_message(scans[0].stamp)))
    answers = player.play(scans[1:20])
    assert (answers.lost, answers.unexpected) == (0, 1)
    assert distances(answers.messages, truth[1:20]).max() < 0.05
    assert node.output().count('odometry reset') == 1


@pytest.mark.parametrize('stamp', [2_100_000_000 * SECOND])
def test_a_single_scan_with_a_wrong_stamp_does_not_restart_the_odometry(node, player, scans, truth, stamp):
    assert played(player, scans[:30]).lost == 0
    assert player.play(restamped(scans[30:31], [stamp])).lost == 0
    answers = player.play(scans[31:40])
    assert answers.lost == 0
    assert distances(answers.messages, truth[31:40]).max() < 0.3


@pytest.mark.parametrize('ahead', [1000])
def test_the_stamp_of_a_scan_that_cannot_be_used_does_not_count(node, player, peer, scans, truth, ahead):
    assert played(player, scans[:10]).lost == 0
    bad = Loudspeaker(peer, LaserScan, 'scan')
    message = changed(scans[10], angle_increment=0.0)
    message.header.stamp = stamp_to_message(scans[10].stamp + ahead * SECOND)
    bad.until(lambda: 'scan skipped: angle_increment' in node.output(), message)
    answers = player.play(scans[10:20])
    assert answers.lost == 0
    assert distances(answers.messages, truth[10:20]).max() < 0.05


def test_scans_without_a_stamp_are_named_and_answered(node, player, peer, scans, truth):
    answers = played(player, restamped(scans[:1], [0]))
    assert answers.lost == 0
    for scan in restamped(scans[1:10], [0] * 9):
        answers = player.play([scan])
        assert answers.lost == 0
        assert np.isfinite(answers.messages[0].twist.twist.linear.x)
        assert np.isfinite(answers.messages[0].twist.covariance).all()
    said(node, 'the scans have no stamp (header.stamp is 0)', peer)
    assert distances(answers.messages, truth[9:10]).max() < 0.05


def test_stamps_in_the_future_are_named_and_answered(node, player, peer, scans, truth):
    ahead = 2 * 10**9 * SECOND
    answers = played(player, restamped(scans[:10], [ahead + k * 100_000_000 for k in range(10)]))
    assert answers.lost == 0
    assert distances(answers.messages, truth[:10]).max() < 0.05
    said(node, 's in the future', peer)
    assert 'use_sim_time' in node.output()


def test_stamps_of_a_recording_are_nothing_to_complain_about(node, player, scans):
    assert played(player, scans[:10]).lost == 0
    assert not [line for line in node.output().splitlines() if 'WARN' in line
                and 'tf2_msgs is not installed' not in line]
