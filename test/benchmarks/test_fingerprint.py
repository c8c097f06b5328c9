# SPDX-License-Identifier: Apache-2.0
"""The fingerprint: two source trees are given the same scans, and compared to the last bit."""
import subprocess

import numpy as np
import pytest
from benchmarks.__main__ import main
from benchmarks.fingerprint import comparison, fingerprint
from benchmarks.fingerprint.inputs import PLACE, inputs, mounted, places

from dbscan_reg_ros import SE2

RENAMED = {
    '__init__.py': '',
    'core/__init__.py': '',
    'core/scan.py': 'class Scan:\n    @classmethod\n    def from_message(cls, message):\n'
                    '        made = cls()\n        made.message = message\n        return made\n',
    'core/geometry/__init__.py': 'class SE2:\n    def __init__(self, x=0.0, y=0.0, theta=0.0):\n'
                                 '        self.x, self.y, self.theta = x, y, theta\n',
    'core/errors.py': 'class ScanError(Exception):\n    pass\n',
    'core/odometry/__init__.py': '',
    'core/odometry/pipeline.py': '''
import enum, math
from types import SimpleNamespace
import numpy as np
from ..errors import ScanError
from ..geometry import SE2
class Status(enum.Enum):
    OK = 'ok'
class Odometry:
    def process(self, scan, prior=None):
        ranges = scan.message.ranges
        if len(ranges) < 3:
            raise ScanError('too few')
        return SimpleNamespace(pose=SE2(float(ranges[0])), covariance=np.eye(3), twist=np.ones(3),
                               twist_covariance=np.eye(3), status=Status.OK)
''',
}
"""A package with the modules in other places."""


@pytest.fixture
def renamed(tmp_path):
    for name, text in RENAMED.items():
        path = tmp_path / 'tree' / 'dbscan_reg_ros' / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / 'tree'


@pytest.fixture
def checkout():
    try:
        fingerprint.resolved('HEAD')
    except fingerprint.BenchmarkError as error:
        pytest.skip(f'needs a checkout with its history: {error}')


def three_scans():
    return {'kind': np.array('odometry'), 'stamps': np.array([0, 10**8, 2 * 10**8]), 'beams': np.array([3, 2, 4]),
            'angles': np.tile((0.0, 0.1, 0.0, 10.0, 0.0), (3, 1)), 'ranges': np.arange(9, dtype=np.float32)}


def test_a_tree_with_other_modules_is_recorded_and_a_scan_that_it_refuses_is_kept(renamed, tmp_path):
    np.savez(tmp_path / 'in.npz', **three_scans())
    recorder = fingerprint.Recorder(renamed, fingerprint.root() / fingerprint.RECORDER, 1, tmp_path / 'log')
    recorder.record(tmp_path / 'in.npz', tmp_path / 'out.npz')
    recorder.close()
    with np.load(tmp_path / 'out.npz') as record:
        np.testing.assert_array_equal(record['pose'][:, 0], [0.0, np.nan, 5.0])
        assert record['status'].tolist() == ['ok', 'refused', 'ok']
        assert record['covariance'].shape == record['twist_covariance'].shape == (3, 3, 3)


def test_what_is_nowhere_in_the_other_tree_is_named(renamed, tmp_path):
    (renamed / 'dbscan_reg_ros' / 'core' / 'odometry' / 'pipeline.py').unlink()
    np.savez(tmp_path / 'in.npz', **three_scans())
    recorder = fingerprint.Recorder(renamed, fingerprint.root() / fingerprint.RECORDER, 1, tmp_path / 'log')
    with pytest.raises(fingerprint.BenchmarkError, match='Odometry: not found in dbscan_reg_ros'):
        recorder.record(tmp_path / 'in.npz', tmp_path / 'out.npz')
    recorder.close()


def test_the_first_scan_that_differs_and_the_largest_difference_are_found(tmp_path):
    pose, status = np.zeros((6, 3)), np.array(['ok'] * 6)
    pose[0] = np.nan
    np.savez(tmp_path / 'a.npz', pose=pose, status=status)
    pose[3, 1], pose[5, 2], status[5] = 1e-300, -0.25, 'no'
    np.savez(tmp_path / 'b.npz', pose=pose, status=status)
    found = comparison.compare('drive', tmp_path / 'a.npz', tmp_path / 'b.npz')
    assert found.first == 3 and found.differing.tolist() == [False, False, False, True, False, True]
    assert found.largest == {'pose': 0.25, 'status': 1.0}
    assert str(found) == '2 differ, from 3 on; largest difference: pose 0.25, status 1'
    same = comparison.compare('drive', tmp_path / 'a.npz', tmp_path / 'a.npz')
    assert same.first is None and str(same) == 'equal'


@pytest.mark.parametrize('kind', ['mounted', 'upside_down', 'moving'])
def test_a_mounted_laser_sees_the_same_as_one_that_looks_along_the_base(kind):
    upright, raw = mounted(kind, 3)
    place = places(kind, np.arange(3) / 10.0)
    assert np.ptp(place[:, 2]) > 0.01 if kind == 'moving' else np.all(place == PLACE.as_array())
    for along, scan, (_, _, yaw) in zip(upright, raw, place, strict=True):
        points = scan.points * (1.0, -1.0) if kind == 'upside_down' else scan.points
        np.testing.assert_allclose(SE2(0.0, 0.0, yaw).apply(points[scan.valid]), along.points[scan.valid], atol=1e-5)


def test_a_commit_is_equal_to_itself_in_the_core_and_through_the_node(checkout, data, tmp_path, capsys):
    pytest.importorskip('rclpy', reason='needs ROS 2 (rclpy)')
    assert main(['fingerprint', '--against', 'HEAD', '--data', str(data), '--limit', '12', '--cache', str(tmp_path),
                 '--only', 'intel_wheels', 'pairs', 'mounted', 'node_moving']) in (0, 1)
    output = capsys.readouterr().out
    changed = subprocess.run(['git', 'status', '--porcelain', 'dbscan_reg_ros'], cwd=fingerprint.root(),
                             capture_output=True,
                             text=True, check=True).stdout
    assert 'all 4 drives are equal' in output or changed
    assert len(list((tmp_path / 'records').rglob('*.npz'))) == 4


def test_an_absent_recording_is_left_out_and_said(tmp_path, capsys):
    assert inputs('aces', tmp_path) == {}
    assert 'left out: aces' in capsys.readouterr().err


@pytest.mark.parametrize('words, message', [
    (['--against', 'HEAD', '--only', 'moon'], "unknown drive 'moon'"),
    (['--against', 'no-such-commit'], 'no-such-commit'),
])
def test_an_unknown_drive_or_commit_is_reported_in_one_line(checkout, data, capsys, words, message):
    assert main(['fingerprint', '--data', str(data), *words]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1
