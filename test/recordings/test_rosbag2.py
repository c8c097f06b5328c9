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
from bags import messages, needs_rosbags, open_bag

from dbscan_reg_ros.recordings import open_recording, read_tum
from dbscan_reg_ros.recordings.conversion import convert, write_log
from dbscan_reg_ros.recordings.recording import Record

pytest.importorskip('rclpy', reason='needs ROS 2 (rclpy)')
REAL = importlib.util.find_spec('rosbag2_py') is not None


@pytest.fixture
def run(root, tmp_path):
    """``run(words, hidden, *folders) -> (status, output)`` of a command that imports from the folders."""
    def run(words, hidden, *folders):
        paths = [root / 'test' / 'without', *folders, root, *filter(None, [os.environ.get('PYTHONPATH')])]
        variables = os.environ | {'PYTHONPATH': os.pathsep.join(map(str, paths)), 'MPLBACKEND': 'Agg',
                                  'WITHOUT_PACKAGES': f'{hidden} {os.environ.get("WITHOUT_PACKAGES", "")}'}
        done = subprocess.run([sys.executable, '-m', 'dbscan_reg_ros', *map(str, words)], cwd=tmp_path, check=False,
                              env=variables, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=120)
        return done.returncode, done.stdout
    return run


@pytest.fixture(params=['the stand-in', pytest.param('the real one', marks=pytest.mark.skipif(
    not REAL, reason='needs the real rosbag2_py, which comes with ROS 2 from apt'))])
def command(request, run, root):
    """``command('convert', ...) -> output`` of a command that succeeds with `rosbag2_py` alone."""
    folders = [root / 'test' / 'stand_ins'] if request.param == 'the stand-in' else []

    def command(*words):
        status, output = run(words, 'rosbags', *folders)
        assert status == 0, output
        return output
    return command


@pytest.fixture
def log(tmp_path, scans, truth):
    """A CARMEN log of 40 scans whose laser and wheels moved."""
    write_log(tmp_path / 'drive.log', [Record(scan, pose.as_array(), 0.9 * pose.as_array())
                                       for scan, pose in zip(scans[:40], truth, strict=False)])
    return tmp_path / 'drive.log'


@needs_rosbags
def test_a_log_becomes_the_bag_of_rosbags_and_the_same_log_again(command, log, tmp_path):
    command('convert', log, 'bag', '--storage', 'sqlite3')
    convert(log, tmp_path / 'other')
    for (*ours, message), (*others, other) in zip(messages(tmp_path / 'bag'), messages(tmp_path / 'other'),
                                                  strict=True):
        assert ours == others and repr(message) == repr(other)
    command('convert', 'bag', 'back.log')
    first, second = open_recording(log), open_recording(tmp_path / 'back.log')
    for a, b in zip(first.scans(), second.scans(), strict=True):
        assert (a.stamp, a.geometry, a.ranges.tobytes()) == (b.stamp, b.geometry, b.ranges.tobytes())
    for known in ('wheel_odometry', 'truth'):
        for a, b in zip(getattr(first, known)(), getattr(second, known)(), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-8)


def test_of_a_time_range_all_is_kept_but_a_damaged_message_which_is_named(command, log, tmp_path):
    command('convert', log, 'bag', '--storage', 'sqlite3')
    (file,) = (tmp_path / 'bag').glob('*.db3')
    with closing(sqlite3.connect(file)) as base:
        base.execute("UPDATE messages SET data = x'00010000ff' WHERE id = (SELECT messages.id FROM messages JOIN "
                     "topics ON topic_id = topics.id WHERE name = '/scan' ORDER BY timestamp LIMIT 1 OFFSET 13)")
        base.commit()
    output = command('convert', 'bag', 'part', '--topics', '/scan', '--start', 1, '--end', 2, '--storage', 'sqlite3')
    assert '11 /scan' in output
    assert 'part: damaged message 4 on /scan skipped' in command('convert', 'part', 'part.log')
    stamps = open_recording(log).stamps()
    assert open_recording(tmp_path / 'part.log').stamps() == stamps[10:13] + stamps[14:21]


@needs_rosbags
def test_a_replay_of_a_bag_is_that_of_the_log(command, log, tmp_path):
    command('convert', log, 'bag', '--storage', 'sqlite3')
    for recording in ('bag', log.name):
        assert 'not written' not in command('replay', recording)
    (stamps, poses), (others, other_poses) = (read_tum(tmp_path / 'results' / name / 'latest' / 'trajectory.tum')
                                              for name in ('bag', 'drive'))
    assert stamps.tolist() == others.tolist() and np.array_equal(poses, other_poses) and len(poses) == 40
    assert len(messages(tmp_path / 'results' / 'drive' / 'latest' / 'bag')) == 120


@needs_rosbags
def test_a_simulated_bag_keeps_the_mounting_for_late_listeners(command, tmp_path):
    command('simulate', 'bag', '--world', 'corridor', '--speed', 2, '--mounting', 0.2, 0, 0)
    with open_bag(tmp_path / 'bag') as reader:
        durable = {c.topic: [quality.durability.name for quality in c.ext.offered_qos_profiles]
                   for c in reader.connections}
    assert durable.pop('/tf_static') == ['TRANSIENT_LOCAL']
    assert set(durable) == {'/scan', '/wheel_odom', '/imu', '/truth'} and not any(durable.values())


def test_without_both_a_log_is_replayed_and_a_bag_refused_with_one_line(run, log, tmp_path):
    without = 'rosbags rosbag2_py' if REAL else 'rosbags'
    status, output = run(['replay', log], without)
    (line,) = [line for line in output.splitlines() if 'bag not written' in line]
    assert status == 0 and 'rosbags' in line
    results = tmp_path / 'results' / 'drive' / 'latest'
    assert len(read_tum(results / 'trajectory.tum')[1]) == 40
    assert (results / 'report.html').is_file() and not (results / 'bag').exists()
    (tmp_path / 'bag').mkdir()
    (tmp_path / 'bag' / 'metadata.yaml').write_text('a: 1')
    (tmp_path / 'a.bag').write_bytes(b'#ROSBAG V2.0\n' + bytes(100))
    for name in ('bag', 'a.bag'):
        status, output = run(['replay', name], without)
        assert status == 1 and 'rosbags' in output and len(output.splitlines()) == 1
