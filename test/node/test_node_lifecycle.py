# SPDX-License-Identifier: Apache-2.0
"""The lifecycle node: the same odometry, through the transitions of a lifecycle."""
import signal

import pytest
import rclpy  # noqa: F401 - needs ROS
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from ros_helpers import TIMEOUT, diagnosis, distances

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


def test_it_answers_only_while_active_and_keeps_its_pose_until_it_is_cleaned_up(managed, player, peer, scans, truth):
    """A signal ends it while it is active."""
    def answered(part, truth):
        assert change(peer, Transition.TRANSITION_ACTIVATE)
        player.wait_for_node(TIMEOUT)
        answers = player.play(scans[part])
        assert answers.lost == 0 and distances(answers.messages, truth).max() < 0.05
        assert change(peer, Transition.TRANSITION_DEACTIVATE)
        peer.until(lambda: '/scan' not in topics(peer))

    for impossible in (Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_CLEANUP, 99):
        assert not change(peer, impossible)
    assert state(peer) == State.PRIMARY_STATE_UNCONFIGURED
    peer.until(lambda: topics(peer) == set())
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert state(peer) == State.PRIMARY_STATE_INACTIVE
    peer.until(lambda: '/odom' in topics(peer) and '/scan' not in topics(peer))
    with pytest.raises(PlayerError, match='no node subscribes to'):
        player.wait_for_node(0.5)
    for begin in (0, 10):
        answered(slice(begin, begin + 10), truth[begin:begin + 10])
    received = peer.listen(DiagnosticArray, '/diagnostics')
    assert diagnosis(peer, received, lambda s: s.message == 'inactive')
    assert change(peer, Transition.TRANSITION_CLEANUP)
    peer.until(lambda: topics(peer) == set())
    assert state(peer) == State.PRIMARY_STATE_UNCONFIGURED
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    answered(slice(20, 40), [truth[20].inverse() @ pose for pose in truth[20:40]])
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    managed.signal(signal.SIGINT)
    assert managed.wait(TIMEOUT) == 0, managed.output()
    assert 'Traceback' not in managed.output()


def test_shutdown_takes_everything_away(managed, peer):
    assert change(peer, Transition.TRANSITION_CONFIGURE)
    assert change(peer, Transition.TRANSITION_ACTIVATE)
    assert change(peer, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    assert state(peer) == State.PRIMARY_STATE_FINALIZED
    peer.until(lambda: topics(peer) == set())
