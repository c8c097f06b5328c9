# SPDX-License-Identifier: Apache-2.0
"""Errors beside the published covariances, and the courses on which scans or wheels mislead."""
import dataclasses
import json
import math

import numpy as np
import pytest
from benchmarks.__main__ import main
from benchmarks.odometry import honesty, misleading_courses
from benchmarks.odometry.course import Course
from benchmarks.odometry.drift import Drive

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.evaluation.trackers import Step

GEOMETRY = ScanGeometry(-math.pi / 2, math.pi / 180, 180, 0.1, 30.0)
COUNT, INTERVAL = 60, 0.1


def made(off=lambda k: SE2(), status=lambda k: Status.OK, sigma=lambda k: 0.02, rate=0.05, turn=0.0, **changes):
    """Return a drive of 60 scans with 1 m/s, each pose off by `off(k)` in its own frame, and what it publishes."""
    truth = [SE2()]
    for _ in range(COUNT - 1):
        truth.append(truth[-1] @ SE2(INTERVAL, 0.0, turn * INTERVAL))
    scans = [Scan(round(k * INTERVAL * 1e9), np.full(180, 4.0), GEOMETRY) for k in range(COUNT)]
    course = Course(scans, reference=np.array([pose.as_array() for pose in truth]), **changes)
    rates = np.broadcast_to(rate, 3)
    return Drive(course, [Step(pose @ off(k), status(k), covariance=sigma(k) ** 2 * np.eye(3),
                               twist_covariance=np.diag(rates ** 2)) for k, pose in enumerate(truth)])


def test_a_drive_without_errors_is_within_its_covariances():
    row = honesty.figures(made(turn=0.3))
    assert row['scans_count'] == COUNT and row['ok'] == row['steps_within'] == row['5s_within'] == 1.0
    assert row['silent_count'] == row['wrong_count'] == row['fast_count'] == row['turned_count'] == 0
    assert row['ratio_worst'] < 1e-6 and row['final_m'] < 1e-9 and row['right'] == 1.0
    assert row['sigma_m'] == pytest.approx(0.02) and row['rate_sigma_deg'] == pytest.approx(math.degrees(0.05))


def test_twists_of_a_window_add_up_as_fully_correlated():
    """10 twists of 0.05 m/s over 0.1 s: 0.05 m over 1 s, where the pose is too unsure to say more."""
    run = made(lambda k: SE2(0.1 * k * INTERVAL, 0.0, 0.0), sigma=lambda k: 2.0 * k * INTERVAL, rate=(0.05, 0.05, 1e-4))
    published = honesty.Published(run)
    for seconds in (0.1, 1.0, 5.0):
        assert published.change_sigmas(*published.windows(seconds)) == pytest.approx(0.1 / 0.05, rel=1e-3)


def test_a_pose_whose_covariance_grew_by_less_than_its_twists_is_held_to_it():
    """Over 1 s the pose may be off by what two twists allow, sqrt(2) 5 mm, not by 50 mm."""
    def slide(k):
        return SE2(0.03 * min(max(k - 20, 0), 10) / 10, 0.0, 0.0)
    growing, known = (honesty.figures(made(slide, sigma=sigma)) for sigma in (lambda k: 0.02 * (1 + k), lambda k: 0.02))
    assert growing['silent_count'] == 0 and growing['ratio_worst'] == pytest.approx(0.6, abs=0.01)
    assert known['ratio_worst'] == pytest.approx(0.03 / math.hypot(0.005, 0.005), rel=1e-3)
    assert known['silent_count'] == 0
    sure = honesty.figures(made(lambda k: slide(k) @ slide(k), sigma=lambda k: 0.02))
    assert sure['silent_count'] > 10 and sure['silent'] == sure['silent_count'] / COUNT
    ambiguous = honesty.figures(made(lambda k: slide(k) @ slide(k), lambda k: Status.AMBIGUOUS))
    assert ambiguous['silent_count'] == 0 and ambiguous['1s_within'] == sure['1s_within'] < 0.85


def test_a_correction_may_be_as_large_as_the_covariance_that_it_ends():
    def off(k):
        return SE2(1.0 if 20 <= k < 40 else 0.0, 0.0, 0.0)

    def status(k):
        return Status.FAILED if 20 <= k < 40 else Status.OK
    honest = honesty.figures(made(off, status, lambda k: 1.0 if 20 <= k < 40 else 0.02))
    silent = honesty.figures(made(off, status))
    assert honest['silent_count'] == 0 and 0.9 < honest['ratio_worst'] < 1.5
    assert silent['silent_count'] == 20 and honest['wrong_count'] == silent['wrong_count'] == 0
    assert honest['pose_within'] == 1.0 and silent['pose_within'] == pytest.approx(40 / COUNT)


def test_steps_are_counted_that_are_wrong_or_too_fast():
    def leap(k):
        return SE2(0.0, 1.5 if k >= 30 else 0.0, 0.9 if k >= 30 else 0.0)
    row = honesty.figures(made(leap))
    assert row['wrong_count'] == row['fast_count'] == row['turned_count'] == 1
    assert row['right'] == 0.0 and row['final_m'] == pytest.approx(1.5) and row['driven_worst_m'] > 1.0


def test_errors_of_the_truth_are_no_errors_and_what_is_not_published_is_left_out():
    rng = np.random.default_rng(0)
    noise = rng.normal(0.0, 0.014, (COUNT, 2))
    run = made(lambda k: SE2(*noise[k], 0.0), rate=0.01)
    assert honesty.figures(run)['silent_count'] > 20
    known = dataclasses.replace(run.course, truth_sigma=(0.014, 0.0))
    assert honesty.figures(dataclasses.replace(run, course=known))['ratio_worst'] < 5.0
    run = made(lambda k: SE2(1.0 if k == 30 else 0.0, 0.0, 0.0))
    run.steps[30] = dataclasses.replace(run.steps[30], status=Status.FAILED, twist_covariance=None)
    row = honesty.figures(run)
    assert row['ratio_worst'] < 1e-6 and row['ok'] == pytest.approx(59 / COUNT)


def test_the_table_has_a_row_for_each_group(data, tmp_path, capsys):
    path = tmp_path / 'rates.json'
    assert main(['odometry', '--data', str(data), '--course', 'hedge', '--view', 'honesty', '--seeds', '2', '--limit',
                 '20', '--json', str(path)]) == 1
    output = capsys.readouterr().out
    assert 'hedge, prior none, dbscan' in output and 'missed: hedge_rplidar_a_new_silent_count = ' in output
    assert 'fixed_silent' not in output
    row = json.loads(path.read_text())['dbscan']
    groups = [f'hedge_{lidar}_{kind}' for lidar in ('rplidar_a', 'lds') for kind in ('new', 'fixed')]
    assert [row[f'{group}_scans_count'] for group in groups] == 4 * [40]
    assert row['hedge_rplidar_a_fixed_silent_count'] == 0


def test_the_motion_along_a_hedge_of_other_leaves_is_degenerate():
    """After 2 s; where the same leaves are seen again, it is known."""
    for course, status in zip(misleading_courses.hedge(seeds=(0,)), (Status.DEGENERATE, Status.OK), strict=False):
        odometry = Odometry()
        found = [odometry.process(scan).status for scan in course.scans][20:]
        assert found.count(status) >= 0.9 * len(found) > 70, course.group
