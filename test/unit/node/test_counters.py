# SPDX-License-Identifier: Apache-2.0
"""Counters of the node, fed by a real odometry."""
import dataclasses

import numpy as np
import pytest

from dbscan_reg_ros import Odometry, Parameters, Status
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
