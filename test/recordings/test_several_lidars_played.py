# SPDX-License-Identifier: Apache-2.0
"""A recording of two lidars in the commands: played to the real node, shown by its page, or refused."""
import re

import numpy as np
import pytest
from bags import laser_scan, needs_rosbags, write_bag
from events import Reader
from ros_helpers import Peer, needs_tf2_msgs, said
from two_lidars import bag_of_two_lidars

from dbscan_reg_ros.__main__ import main
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.recordings import open_recording, read_tum
from dbscan_reg_ros.recordings.conversion import Kept, convert
from dbscan_reg_ros.recordings.poses import compose

TOPICS = '--topic', '/scan', '--topic', '/scan_2'


@pytest.fixture(scope='module')
def pair(tmp_path_factory):
    return bag_of_two_lidars(tmp_path_factory.mktemp('pair') / 'pair', '--speed', '6')


@needs_rosbags
def test_the_demo_refuses_two_lidars_of_a_log(capsys, tmp_path):
    (tmp_path / 'two.log').write_text('FLASER 1 1.0 0 0 0 0 0 0 1.0 nohost 1.0\n')
    assert main(['demo', '--out', str(tmp_path / 'out'), str(tmp_path / 'two.log'), '--topic', 'FLASER', '--topic',
                 'RLASER']) == 2
    line, = capsys.readouterr().err.splitlines()
    assert 'expected a bag for several lidars' in line and 'replay --topic A --topic B --mounting A X Y DEG' in line


@needs_rosbags
@needs_tf2_msgs
def test_the_demo_gives_the_poses_of_the_first_of_two_lidars(start_command, pair, tmp_path):
    process = start_command('demo', '--out', tmp_path / 'out', pair, *TOPICS)
    assert process.wait(120.0) == 0, process.output()
    found = re.search(r'scans (\d+) skipped 0 path 37\.\d m final error (\d\.\d+) m', process.output())
    assert int(found[1]) == open_recording(pair, '/scan').count and float(found[2]) < 0.05
    assert 'ready: /scan, /scan_2 -> /odom' in (tmp_path / 'out' / 'scan_matcher.log').read_text()
    stamps, _ = read_tum(tmp_path / 'out' / 'trajectory.tum')
    assert stamps.tolist() == open_recording(pair, '/scan').stamps()


@needs_rosbags
def test_the_demo_reads_mountings_from_the_parameter_file_and_names_a_prior_without_data(start_command, tmp_path):
    """The bag has no transforms."""
    bag, file = tmp_path / 'bag', tmp_path / 'sensors.yaml'
    convert(bag_of_two_lidars(tmp_path / 'begin', '--speed', '6', '--seconds', '3'), bag, Kept(topics=TOPICS[1::2]))
    words = 'demo', '--out', tmp_path / 'out', bag
    process = start_command(*words, *TOPICS)
    assert process.wait(60.0) == 2
    assert process.output().endswith('; state it: NAME.laser_pose with sensors in the parameter file\n')
    file.write_text("""/**:
  ros__parameters:
    prior.source: odometry
    sensors: [front, rear]
    front: {topic: /scan, laser_pose: [0.3, 0.2, 0.785398]}
    rear: {topic: /scan_2, laser_pose: [-0.3, -0.2, -2.356194]}
""")
    process = start_command(*words, '--params-file', file)
    assert process.wait(120.0) == 0, process.output()
    assert process.output().splitlines()[-1] == f'scans {open_recording(bag, "/scan").count} skipped 0'
    assert process.output().count("prior.source 'odometry' has no effect in demo, which plays scans and static") == 1
    assert 'has no data at the time of the scan' not in (tmp_path / 'out' / 'scan_matcher.log').read_text()


@needs_rosbags
def test_the_demo_plays_the_mountings_on_tf_too(tmp_path):
    from dbscan_reg_ros.commands.demo import _channels
    from dbscan_reg_ros.recordings.bags.with_rosbags import MessageMaker
    empty = bytes(MessageMaker().serialize('tf2_msgs/msg/TFMessage', {}))
    bag = write_bag(tmp_path / 'bag', [('/scan', 10, laser_scan()), ('/scan_2', 10, laser_scan()), ('/tf', 10, empty)],
                    kinds={'/tf': 'tf2_msgs/msg/TFMessage'})
    recording = open_recording(bag, '/scan')
    assert {channel.recorded for channel in _channels(recording, ['/scan_2'])} == {'/scan_2', '/tf'}
    assert _channels(recording, []) == []


@needs_rosbags
@needs_tf2_msgs
def test_two_lidars_are_played_in_lockstep_and_the_page_finds_their_topics(start_command, ros_environment, pair):
    """The page knows /scan alone; the odometry has the stamps of /scan_2."""
    with Peer() as peer:
        node = start_command('scan_matcher', '--ros-args', '-p', 'scan_topics:=[/scan_2, /scan]')
        said(node, 'ready: /scan_2, /scan -> /odom', peer)
        page = start_command('watch')
        said(page, 'from another computer: ssh -L ', peer)
        reader = Reader('127.0.0.1', int(re.search(r'http://127\.0\.0\.1:(\d+)/', page.output())[1]))
        peer.until(lambda: peer.node.count_subscribers('/scan_2') == 2)
        player = start_command('play', '--lockstep', pair, '--topic', '/scan_2', '--topic', '/scan')
        assert player.wait(120.0) == 0, player.output()
        recording = open_recording(pair, '/scan_2')
        assert player.output().splitlines()[-1] == (f'/scan_2: scans {recording.count} answered {recording.count} '
                                                    'skipped 0')
        assert f'/scan {open_recording(pair, "/scan").count}' in player.output()
        assert 'change from the frame' not in node.output()
        times = {round(reader.next('scan')[1]['time'], 3) for _ in range(10)}
        reader.close()
        # Until two scans of /scan_2 have come it may be silent, and those of /scan have odometry, too.
        assert len(times - {round(1e-9 * stamp, 3) for stamp in recording.stamps()}) <= 2


@needs_rosbags
def test_the_truth_of_one_lidar_is_converted_to_the_other_or_taken_as_it_is_with_a_note(pair):
    front, rear = (open_recording(pair, topic) for topic in ('/scan', '/scan_2'))
    (stamps, first), (same, second) = front.truth(), rear.truth()
    assert stamps.tolist() == same.tolist() and front.notes == []
    assert rear.notes == ["/truth has poses of 'laser': converted by /tf_static to those of 'laser_2'"]
    # The rear lidar is 0.6 m behind and 0.4 m to the right of the front one, both measured on the base.
    base = compose(first, SE2(0.3, 0.2, np.radians(45.0)).inverse().as_array()[None])
    np.testing.assert_allclose(second, compose(base, np.array([(-0.3, -0.2, np.radians(-135.0))])), atol=1e-9)
    rear.frame_id = 'elsewhere'
    np.testing.assert_array_equal(rear.truth()[1], first)
    assert rear.notes[-1] == ("/truth has poses of 'laser', the lidar is in 'elsewhere': taken as poses of the lidar, "
                              'because /tf_static has no upright transform between them')
