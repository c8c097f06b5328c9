# SPDX-License-Identifier: Apache-2.0
"""Trajectory files, truth, and the measures: in agreement with the yardstick to the last digits."""
import json
import math
import subprocess
import sys

import numpy as np
import pytest

from dbscan_reg_ros import SE2, RecordingError
from dbscan_reg_ros.evaluation import metrics
from dbscan_reg_ros.evaluation.known_motion import KnownMotion
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.recordings.trajectories import read_csv, read_tum, write_csv, write_tum
from dbscan_reg_ros.recordings.truth import find_relations, interpolate, load_relations


@pytest.fixture(scope='module')
def intel(data):
    """Stamps, wheel odometry, reference and relations of the Intel log."""
    recording = open_recording(data / 'intel' / 'intel.log.gz')
    stamps, odometry = recording.wheel_odometry()
    _, reference = read_csv(data / 'intel' / 'reference.csv')
    return stamps, odometry, reference, load_relations(find_relations(recording.path))


def yardstick(data, path, *options):
    tool = data.parent / 'tools' / 'evaluate_intel.py'
    if not tool.exists():
        pytest.skip(f'no yardstick at {tool}')
    result = path.with_suffix('.json')
    subprocess.run([sys.executable, tool, path, '--data', data / 'intel', '--json', result, *options],
                   check=True, stdout=subprocess.DEVNULL)
    return json.loads(result.read_text())


def noisy(poses, seed, sigma=(0.01, 0.01, 0.003)):
    """Poses whose every step has an error of its own, so that they drift."""
    steps = relative(poses[:-1], poses[1:]) + np.random.default_rng(seed).normal(0.0, sigma, (len(poses) - 1, 3))
    drifting = [SE2.from_array(poses[0])]
    for step in steps:
        drifting.append(drifting[-1] @ SE2.from_array(step))
    return np.array([pose.as_array() for pose in drifting])


def test_every_measure_agrees_with_the_yardstick_also_where_scans_are_missing(data, intel, tmp_path):
    stamps, _, reference, relations = intel
    kept = np.flatnonzero(np.random.default_rng(2).random(len(stamps)) > 0.2)
    poses = noisy(reference, 6)[kept]
    write_csv(tmp_path / 'poses.csv', poses, kept)
    theirs = yardstick(data, tmp_path / 'poses.csv', '--subset')
    ours = metrics.evaluate(poses, stamps[kept], relations, reference[kept])
    assert 600 < ours['relations'] < 700
    assert max(abs(ours[key] - theirs[key]) for key in ours) < 1e-9


def test_a_trajectory_that_stays_behind_is_frozen():
    reference = np.column_stack((0.1 * np.arange(11), np.zeros(11), np.zeros(11)))
    poses = reference.copy()
    poses[6:, 0] -= 0.1
    assert metrics.step_errors(poses, reference)['frozen'] == pytest.approx(0.1)
    assert metrics.step_errors(reference, reference)['frozen'] == 0.0


def test_a_scale_error_shows_over_the_distance():
    reference = np.column_stack((0.1 * np.arange(101), np.zeros(101), np.zeros(101)))
    measures = metrics.evaluate(reference * [1.02, 1.0, 1.0], reference=reference)
    assert measures['rpe_5m_mean_m'] == pytest.approx(0.1, rel=0.03)
    assert measures['rpe_1m_mean_m'] == pytest.approx(0.02, rel=0.1)
    assert measures['ate_m'] == pytest.approx(0.02 * np.std(reference[:, 0]))


def test_no_motion_is_measured_across_a_hole_in_the_truth():
    """The robot drives on where the truth is unknown, and the odometry is wrong there."""
    reference = np.column_stack((0.125 * np.arange(101), np.zeros(101), np.zeros(101)))
    poses = reference.copy()
    poses[45:, 1] += 7.0
    reference[40:50] = np.nan
    measures = metrics.evaluate(poses, reference=reference)
    assert measures['rpe_1m_p95_m'] < 1e-9 and measures['step_p95_m'] < 1e-9
    scans, later = metrics.apart(reference, 1.0)
    assert scans.tolist() == [*range(32), *range(50, 93)] and (later - scans).tolist() == [8] * 75
    assert measures['ate_m'] > 0.5 and 'rpe_5m_mean_m' not in metrics.evaluate(poses[:60], reference=reference[:60])


def test_no_motion_is_measured_across_a_hole_in_a_trajectory():
    """One or two scans without a pose are no hole."""
    numbers = np.r_[0:40, 41:50, 52:60, 63:101]
    reference = np.column_stack((0.125 * numbers, np.zeros((len(numbers), 2))))
    first, later = (numbers[rows] for rows in metrics.apart(reference, 1.0, numbers))
    within = [number for number in numbers if number + 8 < 60 or 63 <= number <= 92]
    assert first.tolist() == within and set((later - first).tolist()) == {8, 9, 10}
    known = np.isin(np.arange(101), numbers)
    assert [part.tolist() for part in metrics.without_holes(known)] == [[*numbers[:57]], [*numbers[57:]]]


def test_truth_is_interpolated_where_it_is_generally_sparse_but_not_in_its_holes():
    """Scans at 10 Hz."""
    stamps = 100_000_000 * np.arange(200)
    poses = np.column_stack((0.1 * np.arange(200), np.zeros(200), np.zeros(200)))
    for step in 1, 2, 10:
        kept = np.arange(200) % step == 0
        found = KnownMotion((stamps[kept], poses[kept]), None, None).true_poses(stamps).poses
        np.testing.assert_allclose(found[:191], poses[:191], atol=1e-9)
        kept[50:150] = False
        known = KnownMotion((stamps[kept], poses[kept]), None, None)
        found, explanation, _ = known.true_poses(stamps)
        first = 50 - step
        assert np.isnan(found[first + 1:150]).all() and np.isfinite(found[[first, 150]]).all()
        assert f'{149 - first} where successive poses are more than {0.3 * step:.3f} s apart' in explanation
        assert known.between(stamps[first], stamps[first + 1]) is None
        assert known.between(stamps[first - 20], stamps[first]).x == pytest.approx(2.0)
        assert known.measures(stamps, poses)['rpe_1m_mean_m'] < 1e-9


def test_tum_keeps_every_nanosecond_and_pose(tmp_path):
    stamps = [976052857337530001, 1282836370970876375, 5, 0]
    poses = np.array([[1.25, -3.5, 3.1], [0.0, 0.0, -3.1], [1e-9, 2.0, 0.0], [-40.0, 1.0, math.pi / 2]])
    write_tum(tmp_path / 'a.tum', stamps, poses)
    assert (tmp_path / 'a.tum').read_text().startswith('976052857.337530001 1.250000000 -3.500000000 0 0 0 ')
    read_stamps, read_poses = read_tum(tmp_path / 'a.tum')
    assert read_stamps.tolist() == stamps
    assert np.allclose(read_poses, poses, atol=1e-9)


def test_csv_keeps_poses_bit_for_bit(tmp_path):
    poses = np.random.default_rng(0).normal(size=(20, 3))
    write_csv(tmp_path / 'a.csv', poses, ms=np.arange(20))
    indices, read = read_csv(tmp_path / 'a.csv')
    assert indices.tolist() == list(range(20)) and (read == poses).all()
    assert (tmp_path / 'a.csv').read_text().splitlines()[0] == 'index,x,y,theta,ms'


@pytest.mark.parametrize(('reader', 'content', 'where'), [
    (read_tum, '# stamps\n1.0 0 0 0 0 0 0 1\n2.0 0 0\n', ':3: expected timestamp'),
    (read_tum, '-1.0 0 0 0 0 0 0 1\n', ':1: expected timestamp'),
    (read_tum, '1.0 0 nan 0 0 0 0 1\n', ':1: .*nan'),
    (read_tum, '1700000000000000000 0 0 0 0 0 0 1\n', ':1: .*1700000000000000000 s .*expected seconds'),
    (read_tum, '1.0 0 0 0 0 0 0 0\n', r':1: .*\(0, 0, 0, 0\)'),
    (read_tum, '1.0 0 0 0 1 0 0 0\n2.0 0 0 0 0.99 0 0 0.14\n', 'w come first'),
    (read_tum, '1.0 0 0 0 0 0 0 1\n2.0 0 0 0 0.1 0 0 0.995\n', 'w come first'),
    (read_tum, '1.0 0 0 0 0.5 -0.5 0.5 -0.5\n', '90 deg'),
    (read_csv, 'index,x,y\n0,1,2\n', ':1: expected the columns'),
    (read_csv, 'index,x,y,theta\n0,1,2,three\n', ':2: expected 4 numbers'),
    (load_relations, '1.0 2.0 0 0 0 0 0 0\n1.0 2.0 0 0\n', ':2: expected t1 t2'),
    (load_relations, '# none\n', 'holds no relation'),
])
def test_a_damaged_file_is_refused_with_its_line(tmp_path, reader, content, where):
    path = tmp_path / 'file'
    path.write_text(content)
    with pytest.raises(RecordingError, match=where) as caught:
        reader(path)
    assert str(path) in str(caught.value)


def test_a_trajectory_that_fails_to_be_written_leaves_the_old_one(tmp_path):
    write_tum(tmp_path / 'a.tum', [1], [[0.0, 0.0, 0.0]])
    before = (tmp_path / 'a.tum').read_text()
    with pytest.raises(ValueError, match='whole nanoseconds'):
        write_tum(tmp_path / 'a.tum', [1, 2.5], [[0.0, 0.0, 0.0]] * 2)
    assert (tmp_path / 'a.tum').read_text() == before
    assert [file.name for file in tmp_path.iterdir()] == ['a.tum']


def test_truth_is_interpolated_on_the_shorter_turn():
    stamps, poses = [20, 10, 30], [[2.0, 0.0, -3.1], [1.0, 0.0, 3.1], [2.0, 4.0, -3.1]]
    between = interpolate(stamps, poses, [10, 15, 20, 25, 30, 9, 31])
    assert between[0] == pytest.approx([1.0, 0.0, 3.1])
    assert between[1, :2] == pytest.approx([1.5, 0.0]) and abs(between[1, 2]) == pytest.approx(math.pi)
    assert between[3] == pytest.approx([2.0, 2.0, -3.1])
    assert between[4] == pytest.approx([2.0, 4.0, -3.1])
    assert np.isnan(between[5:]).all()
    assert interpolate([7], [[1.0, 2.0, 3.0]], [7, 8])[0] == pytest.approx([1.0, 2.0, 3.0])
