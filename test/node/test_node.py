# SPDX-License-Identifier: Apache-2.0
"""The node in a process of its own, over real DDS."""
import contextlib
import dataclasses
import math
import re
import signal
import time
from pathlib import Path

import numpy as np
import rclpy.qos
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from ros_helpers import (
    TIMEOUT,
    Loudspeaker,
    Parameters,
    distances,
    inverted,
    needs_tf2_msgs,
    of_base,
    played,
    pose_of,
    restamped,
    said,
    transform,
)
from sensor_msgs.msg import LaserScan
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from dbscan_reg_ros import SE2
from dbscan_reg_ros.commands.processes import package_command
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.node.interfaces.messages import scan_to_message
from dbscan_reg_ros.node.playback.player import Player, PlayerError
from dbscan_reg_ros.robot.parameters import NodeParameters

# Odometry


def test_every_scan_is_answered_with_its_stamp_and_the_true_pose(node, player, scans, truth):
    answers = played(player, scans)
    assert (answers.lost, answers.unexpected) == (0, 0)
    assert [in_nanoseconds(m.header.stamp) for m in answers.messages] == [scan.stamp for scan in scans]
    assert distances(answers.messages, truth).max() < 0.05
    assert {(m.header.frame_id, m.child_frame_id) for m in answers.messages} == {('odom', 'base_link')}
    assert pose_of(answers.messages[0]) == SE2()
    assert not re.search('.*WARN.*', re.sub('.*tf2_msgs is not installed.*', '', node.output()))


def test_best_effort_scans_are_received_and_odometry_is_reliable(node, peer, scans):
    publisher = peer.node.create_publisher(LaserScan, 'scan', rclpy.qos.qos_profile_sensor_data)
    peer.until(lambda: publisher.get_subscription_count())
    [subscription] = peer.node.get_subscriptions_info_by_topic('/scan')
    assert subscription.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert subscription.qos_profile.durability == DurabilityPolicy.VOLATILE
    for topic in ('/odom', '/segments'):
        [endpoint] = peer.until(lambda topic=topic: peer.node.get_publishers_info_by_topic(topic))
        assert endpoint.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    segments = peer.listen(MarkerArray, 'segments')
    peer.until(lambda: publisher.publish(scan_to_message(scans[0])) or segments)


@needs_tf2_msgs
def test_robots_in_one_graph_do_not_touch_each_other(start_node, peer, scans, truth):
    from tf2_msgs.msg import TFMessage
    names = ['/left', '/right']
    nodes = [start_node('-r', f'__ns:={name}', '-r', '/tf:=tf', '-r', '/tf_static:=tf_static') for name in names]
    transforms = [peer.listen(TFMessage, f'{name}/tf') for name in names]
    with contextlib.ExitStack() as stack:
        players = [stack.enter_context(Player(['--ros-args', '-r', f'__ns:={name}'])) for name in names]
        for name, player in zip(names, players, strict=True):
            player.wait_for_node(TIMEOUT)
            peer.greet(f'{name}/scan_matcher')
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
    peer.until(lambda: [len(messages) for messages in transforms] == [21, 21])
    for topic in '/odom', '/tf', '/tf_static':
        assert not peer.node.count_publishers(topic) and not peer.node.count_subscribers(topic)
    assert not any('another node' in node.output() for node in nodes)


def test_of_scans_that_come_too_fast_the_newest_win_and_the_others_are_counted(node, peer, scans):
    publisher = Loudspeaker(peer, LaserScan, 'scan').publisher
    answers = peer.listen(Odometry, 'odom')
    reports = peer.subscribe(DiagnosticArray, '/diagnostics')
    messages = list(map(scan_to_message, restamped(scans, scans[0].stamp + 100_000 * np.arange(len(scans)))))
    for message in messages:
        publisher.publish(message)
    peer.until(lambda: answers and answers[-1].header.stamp == messages[-1].header.stamp)
    assert len(answers) < 80
    stamps = [in_nanoseconds(m.header.stamp) for m in answers]
    assert stamps == sorted(stamps)

    def counts():
        values = {v.key: v.value for v in reports[-1].status[0].values}
        return [int(values[f'scans {kind}']) for kind in ('received', 'processed', 'dropped')]

    peer.until(lambda: reports and counts()[1] == len(answers))
    received, processed, dropped = counts()
    assert received == processed + dropped
    said(node, 'too slow: ', peer)
    assert received > 50


# Transforms


@needs_tf2_msgs
def test_the_transform_is_that_of_the_odometry_and_can_be_switched_off(node, player, peer, scans):
    from tf2_msgs.msg import TFMessage
    player.wait_for_node(TIMEOUT)
    transforms = peer.listen(TFMessage, '/tf')
    parameters = Parameters(peer)
    parameters.names()
    answers = player.play(scans[:5])
    peer.until(lambda: len(transforms) == 5)
    for message, answer in zip(transforms, answers.messages, strict=True):
        [transform] = message.transforms
        assert transform.header == answer.header
        assert transform.child_frame_id == answer.child_frame_id
        assert transform.transform.translation.x == answer.pose.pose.position.x
        assert transform.transform.translation.y == answer.pose.pose.position.y
        assert transform.transform.rotation == answer.pose.pose.orientation
    [result] = parameters.set(publish_tf=False)
    assert result.successful
    peer.until(lambda: not peer.node.count_publishers('/tf'))
    assert player.play(scans[5:10]).lost == 0
    assert len(transforms) == 5


def test_without_tf2_msgs_the_node_warns_once_and_runs(start_node, player, peer, scans, without_tf2_msgs):
    node = start_node(**without_tf2_msgs)
    assert played(player, scans[:3]).lost == 0
    parameters = Parameters(peer)
    for value in (False, True):
        [result] = parameters.set(publish_tf=value)
        assert result.successful
    assert node.output().count('tf2_msgs is not installed: no transform is sent on /tf') == 1


# Where the laser sits


PLACE = SE2(0.3, -0.1, 0.0)
"""Of the laser on the base."""


@needs_tf2_msgs
def test_there_is_no_odometry_before_the_transform_to_the_laser_is_known(start_command, player, peer, scans, truth):
    """Some frames begin with a slash, as in ROS 1; the lidar is upside down."""
    from tf2_msgs.msg import TFMessage
    node = start_command('scan_matcher', '--ros-args', '-p', 'base_frame:=base_footprint')
    player.wait_for_node(TIMEOUT)
    assert player.play(scans[:3], patience=0.2).lost == 3
    said(node, "no transform from 'base_footprint' to 'laser'", peer)
    quality = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = peer.node.create_publisher(TFMessage, '/tf_static', quality)
    to_base, to_mast = transform('base_footprint', 'base_link'), transform('base_link', 'mast', SE2(PLACE.x + 0.1))
    to_laser = transform('/mast', '/laser', SE2(-0.1, PLACE.y), qy=1.0)
    publisher.publish(TFMessage(transforms=[to_base, to_mast, to_laser]))
    turned = [dataclasses.replace(scan, frame_id='/laser') for scan in inverted(scans)]
    peer.until(lambda: not player.play(turned[:1], patience=0.2).lost)
    answers = player.play(turned[1:])
    assert answers.lost == 0
    assert answers.messages[-1].child_frame_id == 'base_footprint'
    assert distances(answers.messages, of_base(truth[1:], PLACE)).max() < 0.06


# Parameters


NUMBERS, TEXTS = 8, 9
"""Types of parameters that are lists of numbers and of texts."""


def test_what_is_wrong_at_the_start_ends_the_node_and_is_named(start_node):
    wrong = {'scan.range_max = -1.0: expected 0.0 to 1000.0 m': start_node('-p', 'scan.range_max:=-1.0'),
             'qos_overrides./scan.subscription = ': start_node(
                 '-p', 'qos_overrides./scan.subscription.reliability:=nonsense'),
             '--params-file missing.yaml: there is no such file': start_node('--params-file', 'missing.yaml'),
             'ROS does not start: ': start_node('-p', 'nonsense'),
             "'/sys/log'": start_node(ROS_LOG_DIR='/sys/log')}
    for says, node in wrong.items():
        assert node.wait(TIMEOUT) == 2
        assert re.search(f'^scan_matcher: .*{re.escape(says)}', node.output(), re.MULTILINE)
        assert 'Traceback' not in node.output()


def test_changes_are_checked_taken_all_or_none_and_count_from_the_next_scan(node, player, peer, scans):
    parameters, defaults = Parameters(peer), NodeParameters().flatten()
    assert played(player, scans[:3]).lost == 0
    for name, value, reason in (
            ('scan.range_max', -1.0, 'range'),
            ('scan.range_max', math.nan, 'range'),
            ('scan.range_max', 'far', 'type'),
            ('scan.range_max', True, 'type'),
            ('publish_tf', 'no', 'type'),
            ('odom_frame', 'map', 'read-only'),
            ('advanced.filter.test', 'guess', "advanced.filter.test = 'guess': expected one of"),
            ('scan.rangemax', 1.0, 'scan.rangemax')):
        [result] = parameters.set(**{name: value})
        assert not result.successful, name
        assert reason in result.reason
        if name in defaults:
            assert parameters.get(name) == [defaults[name]]
    assert not parameters.set_together(scan__range_min=0.03, scan__range_max=-5.0).successful
    assert parameters.get('scan.range_min', 'scan.range_max') == [0.0, 0.0]
    assert parameters.set_together(scan__range_min=0.03, scan__range_max=0.06).successful
    assert parameters.get('scan.range_min', 'scan.range_max') == [0.03, 0.06]
    said(node, 'parameters changed: scan.range_min: 0.0 -> 0.03, scan.range_max: 0.0 -> 0.06', peer)
    assert player.play(scans[3:4], patience=0.5).lost == 1
    said(node, 'scan skipped', peer)
    assert parameters.set(scan__range_max=0)[0].successful
    assert parameters.get('scan.range_max') == [0.0]
    assert player.play(scans[4:6]).lost == 0


# Bad input


# Starting and stopping


def test_a_signal_ends_a_node_quietly_while_it_starts(start, peer, size):
    for delay in np.linspace(0.0, 1.0, size(3, 20)):
        node = start(*package_command('scan_matcher', '--ros-args', '-p', 'mounting:=none'))
        peer.until(lambda node=node: handles_signals(node))
        due = time.monotonic() + delay
        peer.until(lambda due=due: time.monotonic() > due)
        assert_stops(node)


def handles_signals(process):
    """Whether a process has got as far as to take its signals in a thread of their own."""
    blocked = int(re.search('SigBlk:\t(.*)', Path(f'/proc/{process.pid}/status').read_text())[1], 16)
    return blocked >> (signal.SIGTERM - 1) & 1


def test_a_signal_ends_a_busy_node_quietly(node, player, scans):
    def then_signal():
        yield from scans[:7]
        node.signal(signal.SIGINT)
        yield from scans[7:]

    player.wait_for_node(TIMEOUT)
    with contextlib.suppress(PlayerError):
        player.play(then_signal(), rate=100.0, patience=0.1)
    # A machine that is busier still may hold the scans back.
    assert_stops(node, 'tf2_msgs is not installed|no scan for')


def assert_stops(node, expected='tf2_msgs is not installed'):
    """Without a complaint, but for lines like the `expected` pattern."""
    node.signal(signal.SIGINT)
    assert node.wait(TIMEOUT) == 0, node.output()
    assert not re.search('Traceback|Error|Exception|WARN', re.sub(f'.*({expected}).*', '', node.output()))
