# SPDX-License-Identifier: Apache-2.0
"""The benchmarks: known facts about the recordings, moved scans, measures and bounds."""
import dataclasses
import json
import math
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.__main__ import main
from benchmarks.odometry import courses, drift
from benchmarks.odometry.course import Course
from benchmarks.odometry.drift import drive
from benchmarks.registration import pairs, relations
from benchmarks.registration.covariance import calibration
from benchmarks.report import Bound, at_least, at_most

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.registration.records import Prior
from dbscan_reg_ros.core.sensor import Sensor
from dbscan_reg_ros.evaluation.methods import BenchmarkError
from dbscan_reg_ros.evaluation.trackers import PRIORS
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.simulation import Lidar, Path, follow, rooms, simulate


def arguments(data, **changes):
    values = {'data': str(data), 'method': None, 'limit': None, 'verbose': False, 'course': None, 'prior': 'none',
              'poses': None, 'benchmark': 'test', 'copies': None, 'processes': None, 'against': None, 'calls': False,
              'seeds': None}
    return SimpleNamespace(**(values | changes))


def test_pairs_are_those_of_the_file_and_identity_and_icp_do_as_published(data):
    rows = pairs.measure(arguments(data, method=['identity', 'icp'])).metrics
    for name, percents in (('identity', (73, 7, 0.5, 0, 0)), ('icp', (93, 84, 70, 53, 24))):
        found = [100.0 * rows[name][f'pairs_s{s}'] for s in (1, 2, 5, 10, 20)]
        np.testing.assert_allclose(found, percents, atol=3.0)
    assert rows['icp']['median_m'] == pytest.approx(0.025, abs=0.003)


def test_673_relations_join_neighbours_and_357_close_loops(intel_log):
    groups = [item.group for item in relations.trials(intel_log)]
    assert groups.count('relations_neighbour') == 673
    assert groups.count('relations_loop') == 357


@pytest.mark.parametrize('bound, inside, outside, words', [
    (at_least(0.9), 0.9, 0.89, 'at least 0.9'),
    (at_most(2.8), 2.8, 2.81, 'at most 2.8'),
    (Bound(0.9, 0.98), 0.95, 0.99, '0.9 to 0.98'),
])
def test_a_bound_holds_inside_and_never_for_what_was_not_measured(bound, inside, outside, words):
    assert bound.holds(inside)
    assert not bound.holds(outside)
    assert not bound.holds(math.nan)
    assert str(bound) == words


def test_standing_still_scores_on_intel_as_published(data):
    row = drift.measure(arguments(data, method=['identity'], course=['intel'])).metrics['identity']
    assert row['relations'] == 1030
    assert row['frozen'] == 1.0
    assert row['relations_neighbour_mean_m'] == pytest.approx(0.30, abs=0.005)
    assert row['relations_all_mean_m'] == pytest.approx(0.49, abs=0.005)
    assert row['rpe_1m_mean_m'] == pytest.approx(0.92, abs=0.005)
    assert row['rpe_5m_mean_m'] == pytest.approx(4.1, abs=0.05)
    assert row['ate_m'] == pytest.approx(10.0, abs=0.2)


def test_a_gyroscope_gives_rotations_and_wheels_motions():
    poses = [SE2()]
    for turn in np.linspace(-0.5, 0.5, 40):
        poses.append(poses[-1] @ SE2(0.2, 0.0, float(turn)))
    reference = np.array([pose.as_array() for pose in poses])
    course = courses.Course([None] * len(poses), reference=reference, wheels=reference)
    before = Prior(SE2(0.1, 0.0, 0.0), np.diag([0.3, 0.3, 0.4]) ** 2)
    first, *gyroscope = PRIORS['imu'](course)
    priors = [each(before) for each in gyroscope]
    turns = np.array([each.transform.theta for each in priors])
    assert first is None and np.abs(turns - 1.01 * np.linspace(-0.5, 0.5, 40)).max() < 0.012
    assert np.ptp(turns - 1.01 * np.linspace(-0.5, 0.5, 40)) > 0.003
    assert all(math.hypot(each.transform.x, each.transform.y) == pytest.approx(0.1) for each in priors)
    assert all(each.translation_sigma == pytest.approx(0.3) for each in priors)
    first, *wheels = PRIORS['wheel'](course)
    steps = [each(before).transform.as_array() for each in wheels]
    assert first is None and np.allclose(steps, [(0.2, 0.0, turn) for turn in np.linspace(-0.5, 0.5, 40)])
    assert PRIORS['wheel'](courses.Course([None] * 3)) == PRIORS['none'](courses.Course([None] * 3)) == [None] * 3


def test_right_covariances_are_called_right_and_others_not():
    rng = np.random.default_rng(0)
    root = np.diag((0.01, 0.02, 0.003)) @ np.array([[1.0, 0.0, 0.0], [0.5, 1.0, 0.0], [-0.3, 0.2, 1.0]])
    errors = rng.normal(size=(4000, 3)) @ root.T
    right = calibration([(error, root @ root.T) for error in errors])
    assert right['within'] == pytest.approx(0.95, abs=0.01)
    assert right['nees'] == pytest.approx(1.0, abs=0.05)
    assert right['x_spread'] == pytest.approx(1.0, abs=0.05)
    assert right['t_spread'] == pytest.approx(1.0, abs=0.05)
    assert calibration([(error, 0.25 * root @ root.T) for error in errors])['within'] < 0.6
    assert calibration([(error, 4.0 * root @ root.T) for error in errors] + [None] * 4000)['counted'] == 0.5


def test_a_run_prints_a_table_writes_json_and_ends_with_0(data, tmp_path, capsys):
    path = tmp_path / 'rates.json'
    assert main(['relations', '--data', str(data), '--method', 'icp', '--limit', '10', '--json', str(path)]) == 0
    output = capsys.readouterr().out
    assert 'numpy' in output and 'icp' in output
    metrics = json.loads(path.read_text())
    assert {'relations_neighbour', 'relations_loop', 'median_m', 'median_deg', 'ok_precision', 'ok_recall',
            'view_70_100'} <= set(metrics['icp'])


@pytest.mark.parametrize('words, message', [
    (['pairs', '--method', 'guessing'], "unknown method 'guessing'"),
    (['odometry', '--course', 'moon'], "unknown course 'moon'"),
    (['odometry', '--limit', '1'], '--limit 1: a drive of one scan'),
])
def test_unknown_names_are_reported_in_one_line(data, capsys, words, message):
    assert main([*words, '--data', str(data)]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


def test_the_script_runs_with_the_chosen_python(root, data):
    done = subprocess.run([root / 'scripts' / 'bench', 'pairs', '--data', data, '--method', 'identity', '--limit', '2'],
                          env={'PYTHON': sys.executable, 'PATH': '/usr/bin:/bin'}, capture_output=True, text=True,
                          timeout=120)
    assert done.returncode == 0, done.stderr
    assert 'identity' in done.stdout


def test_the_second_scanner_is_used_besides_the_first_and_by_our_odometry_alone():
    """Two seconds of a course: the poses are those of the front scanner, and differ from those that it finds alone."""
    world = rooms(seed=1)
    path = follow(world.tour)
    path = Path(path.times[path.times < 2.0], path.poses[path.times < 2.0])
    front, rear = (simulate(world, path, Lidar(271, math.radians(-135.0), math.radians(1.0), rate=rate, mounting=at,
                                               phase=phase), seed)
                   for seed, (rate, at, phase) in enumerate(((12.5, courses.FRONT, 0.0), (15.0, courses.REAR, 0.019))))
    alone = Course(front.scans, reference=front.truth)
    both = dataclasses.replace(alone, others=((Sensor('rear', courses.FRONT.inverse() @ courses.REAR), rear.scans),))
    found, other = drive('dbscan', both, 'both'), drive('dbscan', alone, 'alone')
    assert found.poses.shape == other.poses.shape == (len(front.scans), 3)
    assert not np.allclose(found.poses, other.poses, atol=1e-5)
    off = found.poses - relative(front.truth[:1], front.truth)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.02
    with pytest.raises(BenchmarkError, match='several lidars take no other method than dbscan'):
        drive('small_gicp', both, 'both')
