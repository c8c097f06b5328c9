# SPDX-License-Identifier: Apache-2.0
"""Counters of the node, fed by a real odometry."""
import dataclasses
import itertools
import math

import numpy as np
import pytest
from ros_helpers import of_base

from dbscan_reg_ros import Odometry, Parameters, Prior, Scan, ScanGeometry, Status
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.node.counters import Counters, Grade
from dbscan_reg_ros.simulation import Lidar, Path, hall, simulate

SPEED = 0.8


def drive(seed, **limits):
    """Counters and updates of a drive of 2 s through a hall at a steady speed."""
    parameters = Parameters()
    parameters = dataclasses.replace(parameters, odometry=dataclasses.replace(parameters.odometry, **limits))
    odometry, counters, updates = Odometry(parameters), Counters(), []
    path = Path(np.array([0.0, 2.0]), np.array([(4.0, 2.2, 0.0), (4.0 + 2.0 * SPEED, 2.2, 0.0)]))
    for scan in simulate(hall(seed), path, Lidar(), seed).scans:
        updates.append(odometry.process(scan))
        counters.processed_scan(updates[-1], SE2(), SE2(), 0.001)
    return counters, updates


@pytest.mark.parametrize('seed', range(3))
def test_a_robot_faster_than_the_limit_fails_with_its_name_and_is_counted(seed):
    """0.8 m/s at a limit of 0.2 m/s: 0.08 m in a tenth of a second exceed the 0.06 m that are allowed."""
    counters, updates = drive(seed, max_speed=0.2)
    failed = [update for update in updates if update.status is Status.FAILED]
    assert len(failed) >= 3 and all('odometry.max_speed' in update.registration.reason for update in failed)
    assert counters.too_fast == len(failed)
    assert max(np.hypot(*update.twist[:2]) for update in updates) <= 0.2 + 1e-9


def test_a_robot_within_the_limits_is_not_counted():
    counters, updates = drive(0)
    assert counters.too_fast == 0 and all(update.status is Status.OK for update in updates)
    assert counters.grade() == (Grade.TRACKING, 'tracking')


def processed(scans, origin=SE2(), sensor_pose=SE2(), priors=None):
    odometry, counters = Odometry(), Counters()
    for scan, prior in zip(scans, priors or [None] * len(scans), strict=True):
        counters.processed_scan(odometry.process(scan, prior), origin, sensor_pose, 0.001)
    return counters


def between_walls(count):
    """Scans between two endless walls, 1.5 m to the left and 0.8 m to the right, that run along 0.5 rad."""
    rng, geometry = np.random.default_rng(1), ScanGeometry(-3.1, 0.017, 360, 0.05, 8.0)
    across = np.sin(geometry.bearings - 0.5)
    ranges = np.where(across > 0.0, 1.5, 0.8) / np.maximum(np.abs(across), 1e-3)
    return [Scan(k * 100_000_000, ranges + rng.normal(0.0, 0.005, 360), geometry) for k in range(count)]


def test_the_degenerate_direction_is_that_in_the_odometry_frame():
    counters = processed(between_walls(5), SE2(theta=0.3))
    grade, message = counters.grade()
    assert math.remainder(counters.degenerate_direction - 0.8, math.pi) == pytest.approx(0.0, abs=0.05)
    assert grade is Grade.LOW_CONFIDENCE and message.startswith('degenerate, along 4')
    assert counters.statuses[Status.DEGENERATE] > 0


def test_lost_and_skipped_scans_have_a_reason(scans):
    rng = np.random.default_rng(1)
    noise = [dataclasses.replace(scan, ranges=rng.uniform(0.5, 20.0, scan.geometry.size)) for scan in scans[3:23]]
    counters = processed([*scans[:3], *noise])
    grade, message = counters.grade()
    assert grade is Grade.LOST and message.startswith('lost: ') and len(message) > len('lost: ')
    assert counters.statuses[Status.FAILED] > 0
    counters.skip('no transform')
    assert counters.grade() == (Grade.LOST, 'no transform') and counters.skipped == 1


def test_the_correction_of_the_wheels_is_that_in_the_base_frame(scans, truth):
    """They measure each distance a tenth too short; the laser sits ahead and aside, the prior is that of the laser."""
    laser = SE2(0.2, 0.1, 0.5)
    bases = of_base(truth, laser)
    steps = [before.inverse() @ now for before, now in itertools.pairwise(bases)]
    priors = [None, *(Prior(laser.inverse() @ SE2(0.9 * step.x, 0.9 * step.y, step.theta) @ laser,
                            np.diag((0.02, 0.02, 0.03)) ** 2) for step in steps)]
    correction = processed(scans, sensor_pose=laser, priors=priors).wheel_correction
    assert 0.06 < correction[0, 0] < 0.13
    assert abs(correction[2, 2]) < 0.04 and abs(correction[2, 0]) < 0.035 and abs(correction[1, 2]) < 0.03
