# SPDX-License-Identifier: Apache-2.0
"""Copies with noise, courses that are hard for a gate, and registrations by the overlap of the views."""
import dataclasses
import json
import math

import numpy as np
import pytest
from benchmarks.__main__ import main
from benchmarks.odometry import misleading_courses, moving_courses, worst
from benchmarks.odometry.course import Course, driven, scatter
from benchmarks.odometry.drift import Drive
from benchmarks.registration import overlap

from dbscan_reg_ros import Odometry
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.evaluation.trackers import Step
from dbscan_reg_ros.simulation import LIDARS


def room(points=4.0):
    geometry = ScanGeometry(-math.pi / 2, math.pi / 180, 180, 0.1, 30.0)
    return Scan(0, np.full(180, points), geometry)


def test_the_scatter_is_two_standard_errors_of_the_mean():
    mean, spread = scatter([{'a': 1.0, 'b': 2}, {'a': 3.0, 'b': 2}, {'a': 2.0, 'b': 2, 'c': 1.0}])
    assert mean == {'a': 2.0, 'b': 2.0}
    assert spread == pytest.approx({'a': 2.0 / math.sqrt(3.0), 'b': 0.0})


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


def test_rates_count_what_is_ok_and_wrong():
    rows = np.array([(0, 1, 1), (0, 0, 1), (0, 0, 0), (3, 1, 0), (3, 1, 1)])
    found = overlap.rates(rows)
    assert found['0_30_pairs_count'] == 3 and found['0_30_right'] == pytest.approx(1 / 3)
    assert found['0_30_ok_count'] == 2 and found['0_30_wrong_count'] == 1 and found['0_30_silent'] == pytest.approx(1
                                                                                                                    / 3)
    assert found['70_100_recall'] == 0.5 and '30_50_right' not in found
    assert found['precision'] == pytest.approx(2 / 3) and found['recall'] == pytest.approx(2 / 3)


@pytest.mark.parametrize('seed', [0, 1, 3])
def test_a_robot_that_was_carried_to_a_room_of_the_same_width_does_not_claim_to_be_in_the_first(seed):
    course = driven(*misleading_courses.other_room(seed), LIDARS['rplidar_a'], seed)
    begin, end = (misleading_courses.BEFORE + late for late in (0.0, misleading_courses.CARRIED))
    odometry = Odometry()
    for scan in course.take(course.seconds < begin).scans:
        assert odometry.process(scan).status is Status.OK
    updates = [odometry.process(scan) for scan in course.take(course.seconds > end).scans]
    assert all(update.status is not Status.OK for update in updates)
    assert min(math.sqrt(update.covariance[0, 0]) for update in updates) > 1.0
