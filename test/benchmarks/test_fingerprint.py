# SPDX-License-Identifier: Apache-2.0
"""The fingerprint: two source trees are given the same scans, and compared to the last bit."""
import subprocess

import numpy as np
import pytest
from benchmarks import fingerprint
from benchmarks.__main__ import main
from benchmarks.fingerprint import PLACE, mounted, places

from dbscan_reg_ros import SE2


@pytest.fixture
def checkout():
    try:
        fingerprint.resolved('HEAD')
    except fingerprint.BenchmarkError as error:
        pytest.skip(f'needs a checkout with its history: {error}')


def test_the_first_scan_that_differs_and_the_largest_difference_are_found(tmp_path):
    pose, status = np.zeros((6, 3)), np.array(['ok'] * 6)
    pose[0] = np.nan
    np.savez(tmp_path / 'a.npz', pose=pose, status=status)
    pose[3, 1], pose[5, 2], status[5] = 1e-300, -0.25, 'no'
    np.savez(tmp_path / 'b.npz', pose=pose, status=status)
    found = fingerprint.compare('drive', tmp_path / 'a.npz', tmp_path / 'b.npz')
    assert found.first == 3 and found.differing.tolist() == [False, False, False, True, False, True]
    assert found.largest == {'pose': 0.25, 'status': 1.0}
    assert str(found) == '2 differ, from 3 on; largest difference: pose 0.25, status 1'
    same = fingerprint.compare('drive', tmp_path / 'a.npz', tmp_path / 'a.npz')
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
                             capture_output=True, text=True, check=True).stdout
    assert 'all 4 drives are equal' in output or changed
    assert len(list((tmp_path / 'records').rglob('*.npz'))) == 4
