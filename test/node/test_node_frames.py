# SPDX-License-Identifier: Apache-2.0
"""Frames: where the laser sits, as transforms say; our own transform, and those of others."""
import itertools

import pytest
import rclpy  # noqa: F401 - needs ROS
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from ros_helpers import (
    LATCHED,
    TIMEOUT,
    Loudspeaker,
    Peer,
    diagnosis,
    restamped,
    said,
    transform,
)

from dbscan_reg_ros import SE2
from dbscan_reg_ros.core.scan import in_nanoseconds

SECOND = 1_000_000_000


def test_scans_of_another_frame_do_not_change_the_mounting(start_command, player, peer, scans, tf_type):
    """One on /tf does nothing, one on /tf_static only while its publisher is there."""
    start_command('scan_matcher')
    player.wait_for_node(TIMEOUT)
    static = peer.node.create_publisher(tf_type, '/tf_static', LATCHED)
    static.publish(tf_type(transforms=[transform('base_link', 'laser', SE2(0.3))]))
    peer.until(lambda: not player.play(scans[:1], patience=0.2).lost)
    with Peer('stray') as other:
        stray = Loudspeaker(other, tf_type, '/tf')
        stray.tell(tf_type(transforms=[transform('elsewhere', 'laser', stamp=scans[1].stamp)]))
        assert player.play(scans[1:4]).lost == 0
        latched = Loudspeaker(other, tf_type, '/tf_static', LATCHED)
        latched.tell(tf_type(transforms=[transform('elsewhere', 'laser')]))
        peer.until(lambda: player.play(scans[4:5], patience=0.2).lost)
    peer.until(lambda: not player.play(scans[5:6], patience=0.2).lost)


def names(endpoints):
    return {f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}' for endpoint in endpoints}


def ours(messages):
    return [t for m in messages for t in m.transforms if t.transform.translation.x != 5.0]


def give_way(node, player, peer, scans, tf_type, message):
    """Let ``/wheels`` send a stray transform, and wait until the node gives way to it."""
    player.wait_for_node(TIMEOUT)
    assert player.play(scans[:3]).lost == 0
    with Peer('wheels') as wheels:
        other = Loudspeaker(wheels, tf_type, '/tf')
        other.until(lambda: 'another node sends a transform' in node.output(), message)


@pytest.fixture
def stray(tf_type, scans):
    return tf_type(transforms=[transform('wheel_odom', 'base_link', SE2(5.0), stamp=scans[3].stamp)])


def test_after_one_stray_transform_ours_is_sent_again(start_node, player, peer, scans, tf_type, stray):
    node = start_node()
    received, reports = peer.listen(tf_type, '/tf'), peer.listen(DiagnosticArray, '/diagnostics')
    give_way(node, player, peer, scans, tf_type, stray)
    status = diagnosis(peer, reports, lambda s: 'another node sends' in s.message)
    assert status.level == DiagnosticStatus.ERROR
    assert ("publishers on /tf: /wheels. A frame has one parent: ours, from 'odom', is not sent until it is silent for "
            '5 s') in status.message
    said(node, "no other node has sent a transform to 'base_link' for 5 s: ours, from 'odom', is sent again", peer)
    diagnosis(peer, reports, lambda s: 'another node sends' not in s.message)
    sent = len(ours(received))
    with peer.spinning():
        assert player.play(scans[3:13], rate=2.0).lost == 0
    assert len(ours(received)) >= sent + 5
    assert node.output().count('another node sends') == 1


def parents(messages):
    """Who sent the transforms to the base, one after the other, and their stamps."""
    sent = [t for m in messages for t in m.transforms if t.child_frame_id == 'base_link']
    return [t.header.frame_id for t in sent], [in_nanoseconds(t.header.stamp) for t in sent]


def rounds(scans, count):
    """`count` scans at 10 Hz: the same ones forth and back, with increasing stamps."""
    turn = itertools.cycle([*scans, *scans[-2:0:-1]])
    return restamped(list(itertools.islice(turn, count)), [scans[0].stamp + k * SECOND // 10 for k in range(count)])


def test_of_two_nodes_on_one_frame_one_sends_and_when_it_ends_the_other(start_node, player, peer, scans, tf_type):
    """They start at the same scan, and each knows the other: none of them is disturbed."""
    nodes = {'odom': start_node(), 'laser_odom': start_node('-r', '__node:=second', '-p', 'odom_frame:=laser_odom')}
    player.wait_for_node(TIMEOUT)
    # A node subscribes once it knows another one that publishes.
    peer.until(lambda: {'/scan_matcher', '/second'} <= names(peer.node.get_subscriptions_info_by_topic('/tf')))
    received = peer.listen(tf_type, '/tf')
    peer.greet('/second')
    run = iter(rounds(scans[:40], 300))
    with peer.spinning():
        player.play(itertools.islice(run, 60), rate=1.0)
    who, stamps = parents(received)
    assert len(set(stamps)) == len(stamps) > 48 and len(set(who)) == 1
    nodes[who[0]].stop()
    with peer.spinning():
        player.play(itertools.takewhile(lambda _: parents(received)[0][-1] == who[0], run), rate=1.0)
        last = list(itertools.islice(run, 5))
        player.play(last, rate=1.0)
    left, stamps = parents(received)
    assert changes(left) == 1 and stamps[-1] == last[-1].stamp


def changes(senders):
    return sum(before != after for before, after in itertools.pairwise(senders))
