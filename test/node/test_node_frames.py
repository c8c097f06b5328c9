# SPDX-License-Identifier: Apache-2.0
"""Frames: where the laser sits, as transforms say; our own transform, and those of others."""
import itertools
import re

import pytest
import rclpy  # noqa: F401 - needs ROS
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from ros_helpers import (
    LATCHED,
    TIMEOUT,
    Loudspeaker,
    Parameters,
    Peer,
    diagnosis,
    distances,
    of_base,
    restamped,
    said,
    transform,
)

from dbscan_reg_ros import SE2
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.frames.transforms import describe_missing

SECOND = 1_000_000_000


def test_where_no_transform_is_found_the_transforms_that_are_there_are_named(start_command, player, peer, scans,
                                                                             tf_type):
    """First they are on topics of a namespace, then their frames have a prefix."""
    node = start_command('scan_matcher')
    message = tf_type(transforms=[transform('robot/base_link', f'robot/{name}') for name in ('laser', 'imu')])
    peer.node.create_publisher(tf_type, '/robot/tf_static', LATCHED)
    player.wait_for_node(TIMEOUT)
    for text in 'start the node with -r /tf_static:=/robot/tf_static', "set base_frame to 'robot/base_link'":
        peer.until(lambda text=text: player.play(scans[:1], patience=0.2).lost and text in node.output())
        peer.node.create_publisher(tf_type, '/tf_static', LATCHED).publish(message)
    assert "let the driver send 'robot/laser'" in node.output()


@pytest.mark.parametrize('parents, text', [
    ({'laser': 'base_footprint', 'base_footprint': 'odom'}, "set base_frame to 'base_footprint'"),
    ({'laser': 'chassis', 'arm': 'chassis'}, "set base_frame to 'chassis'"),
    ({'base_link': 'odom', 'base_scan': 'base_link', 'laser_frame': 'base_link'}, "let the driver send 'laser_frame'"),
    ({'base_link': 'odom', 'laser': 'mast'}, "no transform connects 'mast', to which 'laser' belongs"),
    ({'wheel': 'axle'}, "base_frame 'base_link' is none of them"),
])
def test_frames_that_are_there_are_named_in_place_of_a_missing_one(parents, text):
    said = describe_missing(None, 'base_link', 'laser', parents)
    assert text in said and all(repr(frame) in said for frame in (*parents, *parents.values()))


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


def test_a_mounting_that_is_sent_again_keeps_the_pose_and_is_named(start_command, player, peer, scans, truth, tf_type):
    node = start_command('scan_matcher')
    player.wait_for_node(TIMEOUT)
    static = peer.node.create_publisher(tf_type, '/tf_static', LATCHED)
    old, new = SE2(0.3), SE2(0.2, 0.1, 0.8)
    static.publish(tf_type(transforms=[transform('base_link', 'laser', old)]))
    peer.until(lambda: not player.play(scans[:1], patience=0.2).lost)
    first = player.play(scans[1:20])
    Loudspeaker(peer, tf_type, '/tf_static', LATCHED).tell(tf_type(transforms=[transform('base_link', 'laser', new)]))
    second = player.play(scans[20:40])
    assert first.lost == second.lost == 0
    before = of_base(truth[:20], old)
    after = [before[-1] @ new @ truth[19].inverse() @ pose @ new.inverse() for pose in truth[20:40]]
    assert distances(first.messages + second.messages, before[1:] + after).max() < 0.1
    said(node, "the transform from 'base_link' to 'laser' was sent again with other values: x 0.300 m, y 0.000 m, "
         'yaw 0.0 deg became x 0.200 m, y 0.100 m, yaw 45.8 deg', peer)
    assert not re.search('max_|could not be registered|not known at the time', node.output())


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


def test_tf_is_subscribed_to_only_while_we_and_others_publish_it(start_node, player, peer, scans, tf_type):
    node = start_node()
    player.wait_for_node(TIMEOUT)
    assert player.play(scans[:3]).lost == 0
    assert peer.node.count_publishers('/tf') == 1 and peer.node.count_subscribers('/tf') == 0
    with Peer('arm') as arm:
        other = Loudspeaker(arm, tf_type, '/tf')
        for value in (True, False, True):
            assert Parameters(peer).set(publish_tf=value)[0].successful
            other.until(lambda hears=value: peer.node.count_subscribers('/tf') == hears,
                        tf_type(transforms=[transform('elbow', 'hand')]))
    peer.until(lambda: peer.node.count_subscribers('/tf') == 0)
    assert player.play(scans[3:6]).lost == 0
    assert node.stop() == 0
    assert 'Traceback' not in node.output()


def test_tf_is_not_subscribed_to_if_no_transform_is_sent_or_read(start_node, player, peer, tf_type):
    start_node('-p', 'publish_tf:=false')
    player.wait_for_node(TIMEOUT)
    peer.node.create_publisher(tf_type, '/tf', 100)
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    peer.until(lambda: len(reports) == 3)
    assert peer.node.count_subscribers('/tf') == 0
