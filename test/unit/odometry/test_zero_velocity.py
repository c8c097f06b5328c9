# SPDX-License-Identifier: Apache-2.0
"""Zero-velocity update: the mean of the measured poses, once the sensor has been at rest for a second."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.models.pose_output import ZeroVelocityUpdate

COVARIANCE = np.diag([0.01, 0.02, 0.005]) ** 2
LIMIT = 3.0


def update(rest, *pose, interval=0.4):
    return rest.update(SE2(*pose), COVARIANCE, interval, LIMIT).as_array()


def test_from_the_start_the_mean_of_all_poses_is_reported():
    rest = ZeroVelocityUpdate(SE2())
    assert update(rest, 0.02, 0.0, 0.002) == pytest.approx([0.01, 0.0, 0.001])
    assert update(rest, 0.01, 0.03, 0.001) == pytest.approx([0.01, 0.01, 0.001])


def test_a_moving_sensor_is_reported_unchanged_until_a_second_at_rest():
    rest = ZeroVelocityUpdate(SE2())
    assert update(rest, 1.0, 0.0, 0.0) == pytest.approx([1.0, 0.0, 0.0])
    assert update(rest, 1.02, 0.0, 0.0) == pytest.approx([1.02, 0.0, 0.0])
    assert update(rest, 1.01, 0.0, 0.0) == pytest.approx([1.01, 0.0, 0.0])
    assert update(rest, 1.03, 0.0, 0.0) == pytest.approx([(1.0 + 1.02 + 1.01 + 1.03) / 4, 0.0, 0.0])
    assert update(rest, 1.06, 0.0, 0.0) == pytest.approx([1.06, 0.0, 0.0])


@pytest.mark.parametrize('axis, sigma', [(0, 0.01), (1, 0.02), (2, 0.005)])
def test_three_standard_deviations_in_the_sensors_frame_are_a_motion(axis, sigma):
    """It faces along y."""
    start = SE2(1.0, 2.0, 0.5 * math.pi)
    for share, moved in ((2.9, False), (3.1, True)):
        pose = start @ SE2(*(share * sigma * np.eye(3)[axis]))
        found = ZeroVelocityUpdate(start).update(pose, COVARIANCE, 0.1, LIMIT)
        half = start @ SE2(*(0.5 * share * sigma * np.eye(3)[axis]))
        assert found.as_array() == pytest.approx((pose if moved else half).as_array())


def test_a_direction_that_is_hardly_constrained_proves_no_rest():
    """Steps of 0.1 m stay within a sigma of 1 m along a corridor, and are motions."""
    covariance = np.diag([1.0, 0.005, 0.005]) ** 2
    rest = ZeroVelocityUpdate(SE2())
    for k in range(1, 30):
        assert rest.update(SE2(0.1 * k, 0.0, 0.0), covariance, 0.1, LIMIT).as_array() == pytest.approx([0.1 * k, 0, 0])


def test_the_mean_of_two_turns_across_the_seam_lies_on_it():
    rest = ZeroVelocityUpdate(SE2(0.0, 0.0, math.pi - 0.004))
    assert abs(update(rest, 0.0, 0.0, -math.pi + 0.004)[2]) == pytest.approx(math.pi)


def test_the_last_fifty_scans_weigh_most():
    """After 49 more scans each next one counts for a fiftieth."""
    rest = ZeroVelocityUpdate(SE2())
    for _ in range(100):
        update(rest, 0.0, 0.0, 0.0)
    assert update(rest, 0.02, 0.0, 0.0)[0] == pytest.approx(0.02 / 50)
