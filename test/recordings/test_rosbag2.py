# SPDX-License-Identifier: Apache-2.0
"""Bags without `rosbags`, by ROS's own `rosbag2_py`: the real one where it is installed, and a stand-in for it.

Each command runs in a process of its own in which `rosbags` is hidden.
"""
import importlib.util
import os
import sqlite3
import subprocess
import sys
from contextlib import closing

import numpy as np
import pytest

from dbscan_reg_ros.recordings import open_recording, read_tum
from dbscan_reg_ros.recordings.conversion import write_log
from dbscan_reg_ros.recordings.recording import Record

pytest.importorskip('rclpy', reason='needs ROS 2 (rclpy)')


@pytest.fixture(scope='module')
def stand_ins(root):
    return root / 'test' / 'stand_ins'


@pytest.fixture(params=['the stand-in', 'the real one'])
def hiding(request, root, stand_ins):
    """The environment of a process that has `rosbag2_py` and no `rosbags`."""
    if request.param == 'the stand-in':
        return environment(root, stand_ins, hidden='rosbags')
    pytest.importorskip('rosbag2_py', reason='needs the real rosbag2_py, which comes with ROS 2 from apt')
    return environment(root, hidden='rosbags')


@pytest.fixture
def command(hiding, tmp_path):
    """``command('convert', ...) -> (status, output)``, run in the test's folder."""
    return lambda *words: run(words, tmp_path, hiding)


@pytest.fixture
def log(tmp_path, scans, truth):
    """A CARMEN log of 40 scans whose laser and wheels moved."""
    write_log(tmp_path / 'drive.log', [Record(scan, pose.as_array(), 0.9 * pose.as_array())
                                       for scan, pose in zip(scans[:40], truth, strict=False)])
    return tmp_path / 'drive.log'


def environment(root, *folders, hidden=''):
    paths = [root / 'test' / 'without', *folders, root, *filter(None, [os.environ.get('PYTHONPATH')])]
    hidden = f'{hidden} {os.environ.get("WITHOUT_PACKAGES", "")}'
    return os.environ | {'PYTHONPATH': os.pathsep.join(map(str, paths)), 'WITHOUT_PACKAGES': hidden,
                         'MPLBACKEND': 'Agg'}


def run(words, folder, variables):
    result = subprocess.run([sys.executable, '-m', 'dbscan_reg_ros', *map(str, words)], cwd=folder, env=variables,
                            check=False,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=120)
    return result.returncode, result.stdout


def read(path):
    highlevel = pytest.importorskip('rosbags.highlevel', reason='needs rosbags')
    from rosbags.typesys import Stores, get_typestore
    return highlevel.AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))


def messages(path):
    """Topic, record time [ns] and message of all that a bag holds, by `rosbags`."""
    with read(path) as reader:
        return [(c.topic, time, reader.deserialize(raw, c.msgtype)) for c, time, raw in reader.messages()]


def same(first, second):
    """Whether two recordings hold the same scans, wheels and truth."""
    return all((a.stamp, a.geometry, a.ranges.tobytes()) == (b.stamp, b.geometry, b.ranges.tobytes())
               for a, b in zip(first.scans(), second.scans(), strict=True)) and all(
        np.allclose(a, b, atol=1e-8) for known in ('wheel_odometry', 'truth')
        for a, b in zip(getattr(first, known)(), getattr(second, known)(), strict=True))


def test_a_log_becomes_a_bag_and_a_log_again(command, log, tmp_path):
    status, output = command('convert', log, 'bag', '--storage', 'sqlite3')
    assert status == 0, output
    status, output = command('convert', 'bag', 'back.log')
    assert status == 0, output
    assert same(open_recording(log), open_recording(tmp_path / 'back.log'))


def test_a_bag_holds_the_same_as_one_of_rosbags(command, log, tmp_path):
    pytest.importorskip('rosbags', reason='needs rosbags')
    assert command('convert', log, 'bag', '--storage', 'sqlite3')[0] == 0
    assert run(['convert', log, 'other'], tmp_path, os.environ | {'PYTHONPATH': os.pathsep.join(sys.path)})[0] == 0
    for (*ours, message), (*others, other) in zip(messages(tmp_path / 'bag'), messages(tmp_path / 'other'),
                                                  strict=True):
        assert ours == others and repr(message) == repr(other)


def test_a_time_range_and_topics_are_kept(command, log, tmp_path):
    assert command('convert', log, 'bag', '--storage', 'sqlite3')[0] == 0
    status, output = command('convert', 'bag', 'part', '--topics', '/scan', '--start', 1, '--end', 2, '--storage',
                             'sqlite3')
    assert status == 0, output
    assert '11 /scan' in output
    assert command('convert', 'part', 'part.log')[0] == 0
    assert open_recording(tmp_path / 'part.log').stamps() == open_recording(log).stamps()[10:21]


def test_a_replay_of_a_bag_is_that_of_the_log(command, log, tmp_path):
    assert command('convert', log, 'bag', '--storage', 'sqlite3')[0] == 0
    for recording in ('bag', log.name):
        status, output = command('replay', recording)
        assert status == 0, output
        assert 'not written' not in output
    (stamps, poses), (others, other_poses) = (read_tum(tmp_path / 'results' / name / 'latest' / 'trajectory.tum')
                                              for name in ('bag', 'drive'))
    assert stamps.tolist() == others.tolist() and np.array_equal(poses, other_poses) and len(poses) == 40
    assert (tmp_path / 'results' / 'drive' / 'latest' / 'bag' / 'metadata.yaml').is_file()


def test_the_bag_of_a_replay_holds_what_the_node_would_have_published(command, log, tmp_path):
    assert command('replay', log)[0] == 0
    results = tmp_path / 'results' / 'drive' / 'latest'
    found = messages(results / 'bag')
    odom = [message for topic, _, message in found if topic == '/odom']
    transforms = [message.transforms[0] for topic, _, message in found if topic == '/tf']
    assert len(odom) == len(transforms) == 40
    poses = read_tum(results / 'trajectory.tum')[1]
    np.testing.assert_allclose([(m.pose.pose.position.x, m.pose.pose.position.y) for m in odom], poses[:, :2],
                               atol=1e-8)
    markers = [message for topic, _, message in found if topic == '/segments'][-1].markers
    assert [(marker.ns, marker.id) for marker in markers] == [
        ('reference', 1), ('reference', 0), ('current', 1), ('current', 0)]
    assert len(markers[0].points) > 4


def test_a_simulated_bag_keeps_the_mounting_for_late_listeners(command, tmp_path):
    pytest.importorskip('rosbags', reason='needs rosbags')
    status, output = command('simulate', 'bag', '--world', 'corridor', '--speed', 2, '--mounting', 0.2, 0, 0)
    assert status == 0, output
    with read(tmp_path / 'bag') as reader:
        durable = {c.topic: [quality.durability.name for quality in c.ext.offered_qos_profiles]
                   for c in reader.connections}
    assert durable.pop('/tf_static') == ['TRANSIENT_LOCAL']
    assert set(durable) == {'/scan', '/wheel_odom', '/imu', '/truth'} and not any(durable.values())


def test_a_damaged_message_is_left_out_and_named(command, log, tmp_path):
    assert command('convert', log, 'bag', '--storage', 'sqlite3')[0] == 0
    (file,) = (tmp_path / 'bag').glob('*.db3')
    with closing(sqlite3.connect(file)) as base:
        base.execute("UPDATE messages SET data = x'00010000ff' WHERE id = (SELECT messages.id FROM messages JOIN "
                     "topics ON "
                     "topic_id = topics.id WHERE name = '/scan' ORDER BY timestamp LIMIT 1 OFFSET 4)")
        base.commit()
    status, output = command('convert', 'bag', 'back.log')
    assert status == 0 and 'bag: damaged message 5 on /scan skipped' in output
    stamps = open_recording(log).stamps()
    assert open_recording(tmp_path / 'back.log').stamps() == stamps[:4] + stamps[5:]


def test_a_ros_1_bag_still_needs_rosbags(command, tmp_path):
    (tmp_path / 'a.bag').write_bytes(b'#ROSBAG V2.0\n' + bytes(100))
    status, output = command('replay', 'a.bag')
    assert status == 1 and 'rosbags' in output and len(output.splitlines()) == 1


def test_a_damaged_bag_says_what_it_is(command, log, tmp_path):
    assert command('convert', log, 'bag', '--storage', 'sqlite3')[0] == 0
    (tmp_path / 'bag' / 'metadata.yaml').write_text('nothing')
    status, output = command('replay', 'bag')
    assert status == 2 and 'its metadata.yaml is damaged' in output


@pytest.fixture
def without_both(root):
    if importlib.util.find_spec('rosbag2_py'):
        return environment(root, hidden='rosbags rosbag2_py')
    return environment(root, hidden='rosbags')


def test_a_replay_of_a_log_needs_no_library_of_bags(without_both, log, tmp_path):
    status, output = run(['replay', log], tmp_path, without_both)
    assert status == 0, output
    (line,) = [line for line in output.splitlines() if 'bag not written' in line]
    assert 'rosbags' in line
    results = tmp_path / 'results' / 'drive' / 'latest'
    assert len(read_tum(results / 'trajectory.tum')[1]) == 40
    assert (results / 'report.html').is_file() and not (results / 'bag').exists()


def test_without_both_a_bag_is_refused_with_one_line(without_both, tmp_path):
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'metadata.yaml').write_text('a: 1')
    status, output = run(['replay', 'bag'], tmp_path, without_both)
    assert status == 1 and 'rosbags' in output and len(output.splitlines()) == 1
