# SPDX-License-Identifier: Apache-2.0
"""Frames: where the laser sits, as transforms say; our own transform, and those of others."""
import itertools
import math

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
    needs_tf2_msgs,
    of_base,
    played,
    pose_of,
    restamped,
    said,
    transform,
)

from dbscan_reg_ros import SE2, Scan
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.frames.transforms import describe_missing

SECOND = 1_000_000_000


def test_mounting_is_read_from_transforms_by_default_and_the_choices_are_named(start_command, player, peer, scans,
                                                                               tf_type):
    node = start_command('scan_matcher')
    player.wait_for_node(TIMEOUT)
    assert player.play(scans[:3], patience=0.2).lost == 3
    said(node, "no transform from 'base_link' to 'laser'", peer)
    assert "set mounting to 'laser_pose' (with laser_pose) or to 'none'" in node.output()
    assert player.play(scans[3:10], patience=0.2).lost == 7
    assert node.output().count('no transform from') == 1
    static = Loudspeaker(peer, tf_type, '/tf_static', LATCHED)
    message = tf_type(transforms=[transform('base_link', 'laser', SE2(0.3))])
    static.until(lambda: not player.play(scans[10:11], patience=0.2).lost, message)
    assert pose_of(player.play(scans[11:12]).messages[0]).as_array() == pytest.approx([0.1, 0.0, 0.0], abs=0.1)


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


@pytest.mark.long
@needs_tf2_msgs
def test_scans_in_the_base_frame_need_no_transform(start_command, player, scans):
    start_command('scan_matcher', '--ros-args', '-p', 'base_frame:=laser')
    assert played(player, scans[:5]).lost == 0


@pytest.mark.long
def test_frames_that_begin_with_a_slash_as_in_ros_1_are_known_without_it(start_command, player, peer, scans, tf_type):
    start_command('scan_matcher')
    player.wait_for_node(TIMEOUT)
    static = Loudspeaker(peer, tf_type, '/tf_static', LATCHED)
    slashed = [Scan(s.stamp, s.ranges, s.geometry, s.time_increment, '/laser') for s in scans[:2]]
    static.until(lambda: not player.play(slashed[:1], patience=0.2).lost,
                 tf_type(transforms=[transform('/base_link', '/laser', SE2(0.3))]))
    assert player.play(slashed[1:]).lost == 0


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


def test_a_laser_that_moves_on_the_base_gives_the_pose_of_the_base(start_command, player, peer, scans, truth, tf_type):
    """The base stands still on the spot where the sensor starts; the laser drives away on it."""
    start_command('scan_matcher')
    player.wait_for_node(TIMEOUT)
    moving = Loudspeaker(peer, tf_type, '/tf')
    places = [transform('base_link', 'laser', p, stamp=s.stamp)
              for s, p in zip(scans[:40], truth, strict=False)]
    moving.until(lambda: not player.play(scans[:1], patience=0.2).lost, tf_type(transforms=places))
    answers = player.play(scans[1:40])
    assert answers.lost == 0
    assert distances(answers.messages, [SE2()] * 39).max() < 0.05


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
    assert 'max_' not in node.output() and 'could not be registered' not in node.output()


@pytest.mark.long
def test_transforms_whose_stamps_start_again_are_taken(start_command, player, peer, scans_and_truth, tf_type):
    """The base stands still on the spot where the sensor starts.

    The laser drives away on it, and again from elsewhere.
    """
    scans, truth = scans_and_truth
    node = start_command('scan_matcher', '--ros-args', '-p', 'publish_tf:=false', '-p', 'advanced.input.queue_size:=50')
    player.wait_for_node(TIMEOUT)
    moving = Loudspeaker(peer, tf_type, '/tf')
    for away in (SE2(), SE2(5.0, -3.0, 2.0)):
        first = scans[0].stamp + (1000 * SECOND if away == SE2() else 0)
        run = restamped(scans[:20], [first + scan.stamp - scans[0].stamp for scan in scans[:20]])
        places = [transform('base_link', 'laser', p, stamp=s.stamp)
                  for s, p in zip(run, [away @ pose for pose in truth[:20]], strict=True)]
        moving.tell(tf_type(transforms=places))
        answers = player.play(run, rate=4.0)
        assert answers.lost == 0
        assert distances(answers.messages, [SE2()] * 20).max() < 0.05
    said(node, 'odometry reset: the stamps of the scans start again', peer)
    assert 'is not known at the time of the scan' not in node.output()


@pytest.mark.long
def test_stamps_before_1970_take_the_nearest_transform(start_command, player, peer, scans, tf_type):
    node = start_command('scan_matcher')
    player.wait_for_node(TIMEOUT)
    old = restamped(scans[:5], [(k - 100) * SECOND for k in range(5)])
    assert player.play(old[:1], patience=0.2).lost == 1
    said(node, "no transform from 'base_link' to 'laser'", peer)
    moving = Loudspeaker(peer, tf_type, '/tf')
    message = tf_type(transforms=[transform('base_link', 'laser', SE2(0.3))])
    moving.until(lambda: not player.play(old[1:2], patience=0.2).lost, message)
    assert player.play(old[2:]).lost == 0
    said(node, 'is not known at the time of the scan; using the transform of another time', peer)


def test_a_transform_that_comes_late_is_waited_for(start_command, player, peer, scans, truth, tf_type):
    start_command('scan_matcher', '--ros-args', '-p', 'advanced.input.max_wait:=10.0')
    player.wait_for_node(TIMEOUT)
    moving = Loudspeaker(peer, tf_type, '/tf')
    places = [transform('base_link', 'laser', p, stamp=s.stamp)
              for s, p in zip(scans[:40], truth, strict=False)]
    moving.until(lambda: not player.play(scans[:1], patience=0.2).lost, tf_type(transforms=places[:1]))
    assert player.play(scans[1:2], patience=0.5).lost == 1
    with peer.spinning():
        moving.publisher.publish(tf_type(transforms=places))
        answers = player.play(scans[2:3], patience=5.0)
    assert answers.unexpected == 1
    assert distances(answers.messages, [SE2()]).max() < 0.05


def test_the_inverse_transform_is_sent_where_asked_for(start_node, player, peer, scans, tf_type):
    start_node('-p', 'invert_tf:=true', '-p', 'odom_frame:=laser_odom')
    player.wait_for_node(TIMEOUT)
    received = peer.subscribe(tf_type, '/tf')
    answers = player.play(scans[:10])
    peer.until(lambda: len(received) == 10)
    for message, answer in zip(received, answers.messages, strict=True):
        [sent] = message.transforms
        assert (sent.header.frame_id, sent.child_frame_id) == ('base_link', 'laser_odom')
        assert sent.header.stamp == answer.header.stamp
        t, q = sent.transform.translation, sent.transform.rotation
        identity = SE2(t.x, t.y, 2.0 * math.atan2(q.z, q.w)) @ pose_of(answer)
        assert identity.as_array() == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize('parent', ['wheel_odom', 'odom'])
def test_a_second_parent_of_the_base_is_named_and_ours_withdrawn(start_node, player, peer, scans, tf_type, parent):
    node = start_node()
    player.wait_for_node(TIMEOUT)
    received = peer.listen(tf_type, '/tf')
    assert player.play(scans[:3]).lost == 0
    assert not any('another node sends' in line for line in node.output().splitlines())
    with Peer('wheels') as wheels:
        other = Loudspeaker(wheels, tf_type, '/tf')
        message = tf_type(transforms=[transform(parent, 'base_link', SE2(5.0), stamp=scans[3].stamp)])
        other.until(lambda: 'another node sends a transform' in node.output(), message)
        assert f"to 'base_link' too, from '{parent}'" in node.output()
        assert '/wheels' in node.output()
    sent = len(ours(received))
    assert player.play(scans[3:10]).lost == 0
    assert len(ours(received)) == sent
    assert Parameters(peer).set(publish_tf=False)[0].successful
    peer.until(lambda: '/scan_matcher' not in publishers(peer))


def publishers(peer):
    return names(peer.node.get_publishers_info_by_topic('/tf'))


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


def test_publish_tf_set_to_true_sends_at_once(start_node, player, peer, scans, tf_type, stray):
    node = start_node()
    received = peer.listen(tf_type, '/tf')
    give_way(node, player, peer, scans, tf_type, stray)
    assert Parameters(peer).set(publish_tf=True)[0].successful
    assert 'no other node has sent a transform' not in node.output()
    sent = len(ours(received))
    assert player.play(scans[3:6]).lost == 0
    peer.until(lambda: len(ours(received)) == sent + 3)


def test_a_static_transform_is_given_way_to_while_its_publisher_is_there(start_node, player, peer, scans, tf_type):
    """A publisher of another static transform stays when the one with ours goes.

    Which of them remain is known once all are received again.
    """
    joints = peer.node.create_publisher(tf_type, '/tf_static', LATCHED)
    joints.publish(tf_type(transforms=[transform('base_link', 'laser')]))
    node = start_node()
    player.wait_for_node(TIMEOUT)
    reports = peer.listen(DiagnosticArray, '/diagnostics')
    with Peer('wheels') as wheels, Peer('arm') as arm:
        arm.node.create_publisher(tf_type, '/tf_static',
                                  LATCHED).publish(tf_type(transforms=[transform('base_link', 'hand')]))
        static = wheels.node.create_publisher(tf_type, '/tf_static', LATCHED)
        static.publish(tf_type(transforms=[transform('map', 'base_link')]))
        peer.until(lambda: "another node sends a transform to 'base_link' too, from 'map'" in node.output())
        assert 'is not sent until that publisher has gone' in node.output()
        diagnosis(peer, reports, lambda s: s.level == DiagnosticStatus.ERROR)
        arm.node.destroy_node()
        before = len(reports)
        peer.until(lambda: reports[-1].header.stamp.sec > reports[before - 1].header.stamp.sec + 6)
        assert {s.level for message in reports[before:] for s in message.status} == {DiagnosticStatus.ERROR}
    said(node, 'is sent again', peer)
    assert node.output().count('another node sends') == 1
    assert player.play(scans[:3]).lost == 0


@pytest.mark.long
def test_a_static_transform_is_given_way_to_again_when_publish_tf_is_set(start_node, player, peer, tf_type):
    static = peer.node.create_publisher(tf_type, '/tf_static', LATCHED)
    static.publish(tf_type(transforms=[transform('map', 'base_link')]))
    node = start_node()
    said(node, "too, from 'map'; publishers on /tf_static: /peer", peer)
    for value in (False, True):
        assert Parameters(peer).set(publish_tf=value)[0].successful
    peer.until(lambda: node.output().count("too, from 'map'; publishers on /tf_static: /peer") == 2)


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


def test_two_nodes_that_are_the_same_do_not_take_the_other_s_transforms_for_their_own(start_node, player, peer, scans,
                                                                                      tf_type):
    """They have started at the same scan, and what they send is the same to the last bit; both insist on sending."""
    nodes = start_node(), start_node('-r', '__node:=second')
    player.wait_for_node(TIMEOUT)
    peer.until(lambda: {'/scan_matcher', '/second'} <= publishers(peer))
    for name in ('/scan_matcher', '/second'):
        for value in (False, True):
            assert Parameters(peer, name).set(publish_tf=value)[0].successful
    peer.until(lambda: {'/scan_matcher', '/second'} <= publishers(peer))
    received = peer.listen(tf_type, '/tf')
    with peer.spinning():
        player.play(scans[:20], rate=1.0)
    peer.until(lambda: any("too, from 'odom'; publishers on /tf: " in node.output() for node in nodes))
    _, stamps = parents(received)
    assert len(stamps) <= len(set(stamps)) + 1


@pytest.mark.long
def test_a_scan_with_a_stamp_of_the_far_future_does_not_end_the_transform(start_node, player, peer, scans, tf_type):
    start_node()
    player.wait_for_node(TIMEOUT)
    received = peer.subscribe(tf_type, '/tf')
    stamps = [scan.stamp for scan in scans[:10]]
    stamps[4] += 3600 * SECOND
    player.play(restamped(scans[:10], stamps), patience=0.5)
    peer.until(lambda: stamps[9] in parents(received)[1])
    assert set(stamps[:4] + stamps[5:]) <= set(parents(received)[1])


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


@pytest.mark.long
def test_a_static_second_parent_of_the_base_is_named_too(start_node, player, peer, scans, tf_type):
    static = peer.node.create_publisher(tf_type, '/tf_static', LATCHED)
    static.publish(tf_type(transforms=[transform('map', 'base_link')]))
    node = start_node()
    said(node, "too, from 'map'; publishers on /tf_static: /peer", peer)
    assert played(player, scans[:3]).lost == 0


def test_transforms_of_other_robots_do_not_matter(start_node, player, peer, scans, tf_type):
    node = start_node('-r', '/tf:=tf', '-r', '/tf_static:=tf_static', '-r', '__ns:=/left')
    with Peer('right') as right:
        other = right.node.create_publisher(tf_type, '/tf', 100)
        received = peer.listen(tf_type, '/left/tf')
        other.publish(tf_type(transforms=[transform('wheel_odom', 'base_link')]))
        from dbscan_reg_ros.node.playback.player import Player
        with Player(['--ros-args', '-r', '__ns:=/left']) as left:
            assert played(left, scans[:10]).lost == 0
        peer.until(lambda: received)
        other.publish(tf_type(transforms=[transform('wheel_odom', 'base_link')]))
    [sent] = received[-1].transforms
    assert in_nanoseconds(sent.header.stamp) in [scan.stamp for scan in scans[:10]]
    assert 'another node sends' not in node.output()


@pytest.mark.parametrize('words', [['-p', 'prior.source:=tf', '-p', 'mounting:=none']])
def test_without_tf2_msgs_a_prior_from_transforms_is_refused_at_the_start(start_command, without_tf2_msgs, words):
    node = start_command('scan_matcher', '--ros-args', *words, **without_tf2_msgs)
    assert node.wait(TIMEOUT) == 2
    assert "prior.source = 'tf': needs tf2_msgs, which is not installed" in node.output()
    assert 'Traceback' not in node.output()
