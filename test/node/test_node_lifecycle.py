# SPDX-License-Identifier: Apache-2.0
"""The lifecycle node: the same odometry, through the transitions of a lifecycle."""
import signal

import pytest
import rclpy  # noqa: F401 - needs ROS
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from ros_helpers import TIMEOUT, Parameters, diagnosis, distances

from dbscan_reg_ros.node.playback.player import PlayerError


@pytest.fixture
def managed(start_command):
    return start_command('scan_matcher_lifecycle', '--ros-args', '-p', 'mounting:=none')


def change(peer, transition):
    """Ask for a transition once; whether it was made."""
    client = peer.node.create_client(ChangeState, '/scan_matcher/change_state')
    peer.until(client.service_is_ready)
    state(peer)
    future = client.call_async(ChangeState.Request(transition=Transition(id=transition)))
    peer.until(future.done)
    return future.result().success


def state(peer):
    return peer.call(GetState, '/scan_matcher/get_state', GetState.Request()).current_state.id


def topics(peer):
    """Topics that the node publishes and subscribes to, without those of every node; None before its discovery."""
    if 'scan_matcher' not in peer.node.get_node_names():
        return None
    every = {'/rosout', '/parameter_events', '/scan_matcher/transition_event', '/clock'}
    names = {name for name, _ in peer.node.get_publisher_names_and_types_by_node('scan_matcher', '/')}
    names |= {name for name, _ in peer.node.get_subscriber_names_and_types_by_node('scan_matcher', '/')}
    return names - every


def test_a_transition_that_is_not_possible_is_refused(managed, peer):
    for impossible in (Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_CLEANUP, 99):
        assert not change(peer, impossible)
        assert state(peer) == State.PRIMARY_STATE_UNCONFIGURED
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert state(peer) == State.PRIMARY_STATE_INACTIVE


def test_it_answers_only_while_active(managed, player, peer, scans, truth):
    assert state(peer) == State.PRIMARY_STATE_UNCONFIGURED
    peer.until(lambda: topics(peer) == set())
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert state(peer) == State.PRIMARY_STATE_INACTIVE
    peer.until(lambda: '/odom' in topics(peer) and '/scan' not in topics(peer))
    with pytest.raises(PlayerError, match='no node subscribes to'):
        player.wait_for_node(0.5)
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    player.wait_for_node(TIMEOUT)
    answers = player.play(scans[:20])
    assert answers.lost == 0
    assert distances(answers.messages, truth[:20]).max() < 0.05
    assert change(peer, Transition.TRANSITION_DEACTIVATE)
    peer.until(lambda: '/scan' not in topics(peer))
    received = peer.listen(DiagnosticArray, '/diagnostics')
    assert diagnosis(peer, received, lambda s: s.message == 'inactive')
    assert change(peer, Transition.TRANSITION_CLEANUP)
    peer.until(lambda: topics(peer) == set())
    assert state(peer) == State.PRIMARY_STATE_UNCONFIGURED


def test_it_can_be_brought_up_again_and_starts_at_the_origin(managed, player, peer, scans, truth):
    for begin in (0, 20):
        assert change(peer, Transition.TRANSITION_CONFIGURE)
        assert change(peer, Transition.TRANSITION_ACTIVATE)
        player.wait_for_node(TIMEOUT)
        answers = player.play(scans[begin:begin + 20])
        assert answers.lost == 0
        back = truth[begin].inverse()
        assert distances(answers.messages, [back @ pose for pose in truth[begin:begin + 20]]).max() < 0.05
        assert change(peer, Transition.TRANSITION_DEACTIVATE)
        assert change(peer, Transition.TRANSITION_CLEANUP)
        peer.until(lambda: not peer.node.count_subscribers('/scan'))


def test_deactivation_keeps_the_pose(managed, player, peer, scans, truth):
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    for begin in (0, 10):
        assert change(peer, Transition.TRANSITION_ACTIVATE)
        player.wait_for_node(TIMEOUT)
        answers = player.play(scans[begin:begin + 10])
        assert answers.lost == 0
        assert distances(answers.messages, truth[begin:begin + 10]).max() < 0.05
        assert change(peer, Transition.TRANSITION_DEACTIVATE)
        peer.until(lambda: not peer.node.count_subscribers('/scan'))


@pytest.mark.long
def test_the_first_scan_of_a_recording_that_starts_again_outlives_a_deactivation(managed, player, peer, scans, truth):
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    player.wait_for_node(TIMEOUT)
    assert player.play(scans[40:50]).lost == 0
    assert player.play(scans[:1], patience=0.5).lost == 1
    assert change(peer, Transition.TRANSITION_DEACTIVATE)
    peer.until(lambda: not peer.node.count_subscribers('/scan'))
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    player.wait_for_node(TIMEOUT)
    answers = player.play(scans[1:10])
    assert (answers.lost, answers.unexpected) == (0, 1)
    assert distances(answers.messages, truth[1:10]).max() < 0.05


def test_parameters_are_there_before_it_is_configured(managed, peer):
    parameters = Parameters(peer)
    [result] = parameters.set(scan__range_max=9.5)
    assert result.successful
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert parameters.get('scan.range_max') == [9.5]


def test_what_cannot_be_configured_is_refused_with_the_reason(start_command, peer, without_tf2_msgs):
    node = start_command('scan_matcher_lifecycle', '--ros-args', '-p', 'mounting:=tf', **without_tf2_msgs)
    assert not change(peer, Transition.TRANSITION_CONFIGURE)
    assert "mounting = 'tf': needs tf2_msgs, which is not installed" in node.output()
    assert state(peer) == State.PRIMARY_STATE_UNCONFIGURED


@pytest.mark.long
def test_a_quality_of_service_that_does_not_exist_is_refused_with_the_reason(start_command, peer):
    node = start_command('scan_matcher_lifecycle', '--ros-args', '-p', 'mounting:=none',
                         '-p', 'qos_overrides./scan.subscription.reliability:=nonsense')
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    for _ in range(2):
        assert not change(peer, Transition.TRANSITION_ACTIVATE)
        assert state(peer) == State.PRIMARY_STATE_INACTIVE
    assert "'reliability': 'nonsense'" in node.output()
    assert 'Traceback' not in node.output()
    assert change(peer, Transition.TRANSITION_CLEANUP)


@pytest.mark.parametrize(('steps', 'number'), [
    ([Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE], signal.SIGINT)])
def test_a_signal_ends_it_in_any_state(managed, peer, steps, number):
    state(peer)
    for step in steps:
        assert change(peer, step)
    managed.signal(number)
    assert managed.wait(TIMEOUT) == 0, managed.output()
    assert 'Traceback' not in managed.output()


def test_shutdown_takes_everything_away(managed, peer):
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    assert change(peer, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert state(peer) == State.PRIMARY_STATE_FINALIZED
    peer.until(lambda: topics(peer) == set())
