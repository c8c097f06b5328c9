# SPDX-License-Identifier: Apache-2.0
"""Copies with noise, courses that are hard for a gate, and registrations by the overlap of the views."""
import dataclasses
import json
import math

import numpy as np
import pytest
from benchmarks.__main__ import main
from benchmarks.odometry import courses, hard_courses, moving_courses, sparse, worst
from benchmarks.odometry.course import Course, scatter
from benchmarks.odometry.drift import Drive
from benchmarks.registration import overlap
from benchmarks.report import Report

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.evaluation.trackers import Step


def room(points=4.0):
    geometry = ScanGeometry(-math.pi / 2, math.pi / 180, 180, 0.1, 30.0)
    return Scan(0, np.full(180, points), geometry)


def test_the_scatter_is_two_standard_errors_of_the_mean():
    mean, spread = scatter([{'a': 1.0, 'b': 2}, {'a': 3.0, 'b': 2}, {'a': 2.0, 'b': 2, 'c': 1.0}])
    assert mean == {'a': 2.0, 'b': 2.0}
    assert spread == pytest.approx({'a': 2.0 / math.sqrt(3.0), 'b': 0.0})


def test_copies_of_a_course_are_printed_and_written_with_their_scatter(data, tmp_path, capsys):
    path = tmp_path / 'copies.json'
    assert main(['odometry', '--data', str(data), '--course', 'aces', '--method', 'dbscan', '--limit', '30', '--copies',
                 '3',
                 '--processes', '1', '--json', str(path)]) == 0
    output = capsys.readouterr().out
    assert 'aces, 3 copies' in output and 'dbscan, +-' in output
    metrics = json.loads(path.read_text())
    assert 0.0 < metrics['dbscan, +-']['aces_step_mean_m'] < metrics['dbscan']['aces_step_mean_m']


def test_sparse_key_frames_miss_their_bounds_where_the_odometry_is_wrong():
    report = Report()
    row = {'odometry': 0.98, 'failed_ok_count': 1}
    report.add_courses('intel', {'intel_1.6m': row, 'intel_2.0m': row}, 'dbscan', sparse.BOUNDS)
    assert report.missed == ['intel_1.6m_odometry = 0.98, expected at least 0.99',
                             'intel_1.6m_failed_ok_count = 1, expected at most 0',
                             'intel_2.0m_failed_ok_count = 1, expected at most 0']


def test_key_frames_two_metres_apart_are_tracked_at_least_as_well_as_registered(data):
    """Two metres and a second apart: the scan before decides where the prediction is weak."""
    course = hard_courses.thinned(courses.intel(data)[0], 2.0).take(slice(115))
    row = sparse.compared('dbscan', course, 'test')
    assert row['odometry'] >= 0.97 and row['odometry'] > row['pairs']
    assert row['failed_ok_count'] == row['silent_count'] == 0


def test_what_is_called_ok_and_is_wrong_is_counted():
    scans = [dataclasses.replace(room(), stamp=k * 10**8) for k in range(60)]
    run = Drive(Course(scans, reference=np.zeros((60, 3))))
    for k in range(60):
        leap = SE2(0.25, 0.0, 0.0) if k >= 30 else SE2()
        run.steps.append(Step(leap, Status.FAILED if k == 10 else Status.OK))
    found = worst.figures(run)
    assert found['step_ok_m'] == found['error_m'] == pytest.approx(0.25)
    assert found['silent_count'] == 1
    assert found['stretches_count'] == 19
    assert found['failed'] == pytest.approx(1 / 60)
    run.steps[30] = dataclasses.replace(run.steps[30], status=Status.AMBIGUOUS)
    assert worst.figures(run)['silent_count'] == worst.figures(run)['stretches_count'] == 0
    assert worst.summary([found, found | {'error_m': 0.75}])['error_worst_m'] == 0.75


def test_moving_courses_drive_free_of_walls_at_the_speeds_they_name():
    for name, make in moving_courses.COURSES.items():
        course = make(seeds=(0,), **({'widths': (0.8,), 'distances': (1.0,)} if name == 'ahead' else {}))[-1]
        way = np.hypot(*np.diff(course.reference[:, :2], axis=0).T)
        nearest = np.array([scan.ranges[scan.valid].min() for scan in course.scans])
        # Companions walk up to 0.21 m close.
        assert nearest.min() > (0.2 if name == 'companions' else 0.25), name
        assert way.sum() > 5.0 and 0.7 < (way / np.diff(course.seconds)).max() < 1.7, name


def test_the_worst_of_a_course_is_that_of_each_kind_of_drive_and_of_all(tmp_path, capsys):
    path = tmp_path / 'rates.json'
    assert main(['odometry', '--view', 'worst', '--course', 'covered', 'spinup', 'pillar', '--seeds', '1', '--limit',
                 '25', '--method', 'dbscan', 'identity', '--json', str(path)]) == 0
    assert 'covered, identity' in capsys.readouterr().out
    metrics = json.loads(path.read_text())
    # A method without covariances has no count of poses within three sigma.
    assert metrics['identity'].keys() == {each for each in metrics['dbscan'] if not each.endswith('_within')}
    assert metrics['dbscan']['covered_sick_lms200_scans_count'] == 75
    assert metrics['dbscan']['covered_scans_count'] == 225 and 'pillar_error_median_m' in metrics['dbscan']
    assert {'covered_late_worst_s', 'spinup_failed_count'} < metrics['dbscan'].keys()


def test_turn_rates_of_published_twists_are_right_while_the_robot_rotates(tmp_path):
    path = tmp_path / 'rates.json'
    assert main(['odometry', '--view', 'worst', '--course', 'spin', '--seeds', '1', '--method', 'dbscan', '--json',
                 str(path)]) == 0
    metrics = json.loads(path.read_text())['dbscan']
    rates = {name: value for name, value in metrics.items() if name.endswith('rms_deg')}
    assert len(rates) == 10 and max(rates.values()) < math.degrees(0.05)
    assert max(value for name, value in rates.items() if 'steady' in name) < math.degrees(0.03)


def test_rates_count_what_is_ok_and_wrong():
    rows = np.array([(0, 1, 1), (0, 0, 1), (0, 0, 0), (3, 1, 0), (3, 1, 1)])
    found = overlap.rates(rows)
    assert found['0_30_pairs_count'] == 3 and found['0_30_right'] == pytest.approx(1 / 3)
    assert found['0_30_ok_count'] == 2 and found['0_30_wrong_count'] == 1 and found['0_30_silent'] == pytest.approx(1
                                                                                                                    / 3)
    assert found['70_100_recall'] == 0.5 and '30_50_right' not in found
    assert found['precision'] == pytest.approx(2 / 3) and found['recall'] == pytest.approx(2 / 3)
