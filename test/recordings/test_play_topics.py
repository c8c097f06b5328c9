# SPDX-License-Identifier: Apache-2.0
"""What `play` publishes besides the scans, received over DDS by a node of the test or used by scan_matcher."""
import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2 (rclpy)')

from bags import SECOND, needs_rosbags, write_bag
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from ros_helpers import LATCHED, TIMEOUT
from sensor_msgs.msg import Imu, LaserScan
from std_msgs.msg import String

from dbscan_reg_ros.__main__ import main
from dbscan_reg_ros.core.scan import in_nanoseconds
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.recordings.conversion import write_log
from dbscan_reg_ros.recordings.message_fields import filled, pose_only_fields, scan_fields
from dbscan_reg_ros.recordings.playback import Channel, Played, Timeline, inputs_of
from dbscan_reg_ros.recordings.recording import Record

COUNT = 6
BEST_EFFORT = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture
def bag(tmp_path, scans, tf_type):
    """A bag in which everything is recorded 20 ms after its stamp, the transforms of the base between two scans."""
    from dbscan_reg_ros.recordings.bags.with_rosbags import serializer
    serialize = serializer(tmp_path / 'bag')
    kinds = {'/scan': 'sensor_msgs/msg/LaserScan', '/tf': 'tf2_msgs/msg/TFMessage',
             '/tf_static': 'tf2_msgs/msg/TFMessage',
             '/base/odom': 'nav_msgs/msg/Odometry', '/imu/data': 'sensor_msgs/msg/Imu',
             '/chatter': 'std_msgs/msg/String'}
    rows = [('/tf_static', 0, {'transforms': [{'header': {'frame_id': 'base_link'}, 'child_frame_id': 'laser'}]})]
    for k, scan in enumerate(scans[:COUNT]):
        for topic, later, fields in (
                ('/scan', 0, scan_fields(scan)),
                                     ('/base/odom', 1, pose_only_fields(scan.stamp, 'base_link', (k, -k, 0.1 * k))),
                ('/imu/data', 2, {'angular_velocity': {'z': 0.5 * k}}), ('/chatter', 3, {'data': f'word {k}'}),
                ('/tf', 50, {'transforms': [{'header': {'frame_id': 'map'}, 'child_frame_id': f'thing{k}'}]})):
            rows.append((topic, scan.stamp + (20 + later) * SECOND // 1000, fields))
    messages = [(topic, time or scans[0].stamp, bytes(serialize(kinds[topic], fields))) for topic, time, fields in rows]
    return write_bag(tmp_path / 'bag', messages, kinds=kinds)


def received(peer, **topics):
    """Name -> list that takes the messages of that kind on that topic."""
    lists = {name: [] for name in topics}
    for name, (kind, topic, quality) in topics.items():
        peer.node.create_subscription(kind, topic, lists[name].append, quality)
    return lists


def everything(peer, tf_type):
    return received(peer, scan=(LaserScan, 'scan', 100), wheels=(Odometry, 'wheel_odom', 100), imu=(Imu, 'imu', 100),
                 tf=(tf_type, '/tf', 100), static=(tf_type, '/tf_static', LATCHED), chatter=(String, '/chatter', 100))


def play(start_command, peer, *words):
    command = start_command('play', *words, '--wait', '20')
    with peer.spinning():
        status = command.wait(TIMEOUT)
    assert status == 0, command.output()
    return command.output()


def test_all_that_the_node_can_use_is_published_as_it_was_recorded(start_command, peer, bag, scans, tf_type):
    lists = everything(peer, tf_type)
    output = play(start_command, peer, bag)
    peer.until(lambda: all(len(lists[name]) == COUNT for name in ('scan', 'wheels', 'imu', 'tf')))
    assert [in_nanoseconds(m.header.stamp) for m in lists['scan']] == [scan.stamp for scan in scans[:COUNT]]
    assert [(m.pose.pose.position.x, m.pose.pose.position.y) for m in lists['wheels']] == [(k, -k)
                                                                                           for k in range(COUNT)]
    assert [m.angular_velocity.z for m in lists['imu']] == [0.5 * k for k in range(COUNT)]
    assert [m.transforms[0].child_frame_id for m in lists['tf']] == [f'thing{k}' for k in range(COUNT)]
    assert [m.transforms[0].child_frame_id for m in lists['static']] == ['laser']
    assert not lists['chatter']
    counts = dict(zip(*[iter(next(line for line in output.splitlines() if line.startswith('messages')).split()[1:])]
                      * 2,
                      strict=True))
    assert counts == {'/tf_static': '1', 'wheel_odom': '6', 'imu': '6', '/tf': '6'}


def test_other_topics_are_published_on_demand(start_command, peer, bag, tf_type):
    lists = everything(peer, tf_type)
    play(start_command, peer, bag, '--topics', '/chatter')
    peer.until(lambda: len(lists['chatter']) == COUNT and len(lists['imu']) == COUNT)
    assert [m.data for m in lists['chatter']] == [f'word {k}' for k in range(COUNT)]


def test_late_subscribers_receive_static_transforms_and_ctrl_c_ends_the_play(start_command, peer, bag, tf_type):
    lists = received(peer, scan=(LaserScan, 'scan', 100))
    command = start_command('play', bag, '--rate', '0.02', '--wait', '20')
    peer.until(lambda: lists['scan'])
    (publisher,) = peer.node.get_publishers_info_by_topic('/tf_static')
    assert publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    (moving,) = peer.node.get_publishers_info_by_topic('/tf')
    assert moving.qos_profile.durability == DurabilityPolicy.VOLATILE
    late = received(peer, static=(tf_type, '/tf_static', LATCHED))['static']
    peer.until(lambda: late)
    assert late[0].transforms[0] == filled(TransformStamped(),
                                           {'header': {'frame_id': 'base_link'}, 'child_frame_id': 'laser'})
    assert command.running() and command.stop() == 0, command.output()
    assert 'Traceback' not in command.output() and 'scans 1 answered 0 skipped 1' in command.output()


@needs_rosbags
def test_the_recorded_mounting_is_enough_for_a_node_that_waits_for_transforms(start_command, tmp_path, tf_type):
    simulate = start_command('simulate', tmp_path / 'drive', '--world', 'corridor', '--speed', '2', '--mounting', '0.2',
                             '0', '90')
    assert simulate.wait(TIMEOUT) == 0, simulate.output()
    start_command('scan_matcher', '--ros-args', '-p', 'prior.source:=odometry')
    command = start_command('play', tmp_path / 'drive', '--lockstep', '--wait', '20')
    assert command.wait(60.0) == 0, command.output()
    count = open_recording(tmp_path / 'drive').count
    assert f'scans {count} answered {count} skipped 0' in command.output()
    assert '/tf_static 1' in command.output() and 'wheel_odom ' in command.output() and 'imu ' in command.output()


def test_the_wheels_of_a_log_are_published_before_the_scans_that_they_belong_to(start_command, peer, tmp_path, scans,
                                                                                truth):
    poses = [pose.as_array() for pose in truth[10:10 + COUNT]]
    write_log(tmp_path / 'a.log', [Record(scan, (0.0, 0.0, 0.0), pose)
                                   for scan, pose in zip(scans[10:10 + COUNT], poses, strict=True)])
    lists = received(peer, scan=(LaserScan, 'scan', 100), wheels=(Odometry, 'wheel_odom', 100))
    play(start_command, peer, tmp_path / 'a.log')
    peer.until(lambda: len(lists['wheels']) == COUNT)
    assert [m.header.stamp for m in lists['wheels']] == [m.header.stamp for m in lists['scan']]
    np.testing.assert_allclose([(m.pose.pose.position.x, m.pose.pose.position.y) for m in lists['wheels']],
                               np.array(poses)[:, :2], atol=1e-8)


def test_damaged_messages_and_types_that_are_not_installed_are_named(start_command, peer, tmp_path, scans):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg('int32 a', 'strange_msgs/msg/Thing'))
    from dbscan_reg_ros.recordings.bags.with_rosbags import serializer
    serialize = serializer(tmp_path / 'bag')
    kinds = {'/scan': 'sensor_msgs/msg/LaserScan', '/imu': 'sensor_msgs/msg/Imu', '/thing': 'strange_msgs/msg/Thing'}
    write_bag(tmp_path / 'bag', [
        ('/imu', 1, b'\0\1\0\0x'), ('/scan', 2, bytes(serialize(kinds['/scan'], scan_fields(scans[0])))),
        ('/imu', 3, bytes(serialize(kinds['/imu'], {}))), ('/thing', 4, b'\0\1\0\0\1\0\0\0')], kinds=kinds, store=store)
    lists = received(peer, scan=(LaserScan, 'scan', 100), imu=(Imu, 'imu', 100))
    output = play(start_command, peer, tmp_path / 'bag', '--all')
    peer.until(lambda: lists['imu'])
    assert len(lists['imu']) == 1 and 'imu: 1 damaged messages skipped' in output
    assert '/thing is not played: its type strange_msgs/msg/Thing is not installed here' in output


def test_a_topic_that_is_not_there_is_refused_with_what_there_is(bag, capsys):
    assert main(['play', str(bag), '--topics', '/other']) == 2
    assert capsys.readouterr().err == ('play: no topic /other; besides the scans there is /base/odom, /chatter, '
                                       '/imu/data, /tf, /tf_static\n')


# Which topics are which, and when each message is due


@pytest.mark.parametrize('kinds, wheels, expected', [
    ({'/tf': 'tf', '/tf_static': 'tf', '/odom': 'odom'}, '/odom',
     {'/odom': 'wheel_odom', '/tf': '/tf', '/tf_static': '/tf_static'}),
    ({'/robot/tf': 'tf', '/robot/tf_static': 'tf'}, None, {'/robot/tf': '/tf', '/robot/tf_static': '/tf_static'}),
    ({'/a/tf': 'tf', '/b/tf': 'tf'}, None, {}),
    ({'/tf': 'tf', '/b/tf': 'tf'}, None, {'/tf': '/tf'}),
    ({'tf': 'old tf'}, None, {'tf': '/tf'}),
    ({'/front': 'imu'}, None, {'/front': 'imu'}),
    ({'/imu/data': 'imu', '/imu/data_raw': 'imu'}, None, {'/imu/data': 'imu'}),
    ({'/left': 'imu', '/right': 'imu'}, None, {}),
])
def test_what_the_node_can_use_is_found_by_type_and_name(kinds, wheels, expected):
    types = {'tf': 'tf2_msgs/msg/TFMessage', 'old tf': 'tf/msg/tfMessage', 'imu': 'sensor_msgs/msg/Imu',
             'odom': 'nav_msgs/msg/Odometry'}
    assert inputs_of({topic: types[kind] for topic, kind in kinds.items()}, wheels) == expected


def test_messages_are_due_as_long_after_a_scan_as_they_were_recorded(scans):
    channel, timeline = Channel('/imu', 'a'), Timeline()
    first, second = scans[:2]
    assert timeline.due(Played(b'', 1, Channel('/tf_static', 'b', latched=True))) == 0
    assert [timeline.due(Played(b'', time, channel)) for time in (100, 400)] == [0, 300] and timeline.start is None
    assert timeline.due(Played(first, 1000)) == 900 and timeline.start == first.stamp - 900
    assert timeline.due(Played(b'', 1300, channel)) == 1200
    assert timeline.due(Played(b'', 900, channel)) == 900
    assert timeline.due(Played(second, 5000)) == second.stamp - timeline.start
