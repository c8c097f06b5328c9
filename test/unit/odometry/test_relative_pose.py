# SPDX-License-Identifier: Apache-2.0
"""Mounting and time offset of a further lidar from comparisons whose truth is known."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.calibration.first_lidar import HALF_SPAN, FirstLidar
from dbscan_reg_ros.core.odometry.calibration.relative_pose import Comparison, estimate_relative_pose

SEEDS = 1, 2, 3
TRUE = SE2(-0.7, -0.5, math.pi - 0.1)
OFFSET = -0.06
SIGMAS = np.array([0.004, 0.004, 0.003])
TWIST_SIGMAS = np.array([0.02, 0.02, 0.01])


def errors(estimate):
    """Errors of x, y, yaw and time offset."""
    return np.array([estimate.pose.x - TRUE.x, estimate.pose.y - TRUE.y,
                     math.remainder(estimate.pose.theta - TRUE.theta, 2.0 * math.pi), estimate.time_offset - OFFSET])


def compared(twists, seed, sigmas=SIGMAS, twist_sigmas=TWIST_SIGMAS):
    """Comparisons at the true `twists` (N, 3), with noise of these standard deviations on poses and twists."""
    rng, found = np.random.default_rng(seed), []
    for k, twist in enumerate(twists):
        angle, half = OFFSET * twist[2], 0.5 * OFFSET * twist[2]
        c, s = math.cos(half), math.sin(half)
        moved = SE2(OFFSET * (c * twist[0] - s * twist[1]), OFFSET * (s * twist[0] + c * twist[1]), angle)
        noisy = moved @ TRUE @ SE2(*rng.normal(0.0, sigmas))
        found.append(Comparison(noisy, np.diag(sigmas ** 2), twist + rng.normal(0.0, twist_sigmas),
                                np.diag(twist_sigmas ** 2), k // 8))
    return found


def curves(seed, count=200):
    """Twists of a drive with curves and different speeds."""
    rng = np.random.default_rng(100 + seed)
    return np.column_stack((rng.uniform(0.0, 1.0, count), np.zeros(count), rng.uniform(-0.8, 0.8, count)))


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('guess', [TRUE, TRUE @ SE2(0.1, -0.2, 0.15)], ids=['right', 'wrong'])
def test_mounting_and_time_offset_are_found(seed, guess):
    estimate = estimate_relative_pose(compared(curves(seed), seed), guess)
    assert estimate.observable.all()
    assert (np.abs(errors(estimate)) < [0.002, 0.002, 0.002, 0.004]).all()
    assert (np.abs(errors(estimate)) < 4.0 * estimate.sigmas).all()


@pytest.mark.parametrize('seed', SEEDS)
def test_the_noise_of_the_twists_does_not_shrink_the_time_offset(seed):
    """The robot moves slowly: the noise of the twists is a third of their scatter."""
    twists = 0.08 * curves(seed, 2000)
    estimate = estimate_relative_pose(compared(twists, seed, twist_sigmas=np.full(3, 0.01)), TRUE)
    assert abs(estimate.time_offset - OFFSET) < min(4.0 * estimate.sigmas[3], 0.012)


@pytest.mark.parametrize('seed', SEEDS)
def test_at_a_constant_speed_a_time_offset_looks_like_a_shift(seed):
    estimate = estimate_relative_pose(compared(np.tile([0.8, 0.0, 0.0], (200, 1)), seed), TRUE)
    assert estimate.observable.tolist() == [False, True, True, False]
    assert (np.abs(errors(estimate)) < 4.0 * estimate.sigmas).all()


@pytest.mark.parametrize('seed', SEEDS)
def test_along_a_straight_corridor_nothing_is_observable(seed):
    """The map does not constrain the pose along the x axis of the first lidar; in a curve it does constrain it."""
    twists = np.column_stack((np.linspace(0.2, 1.0, 200), np.zeros((200, 2))))
    comparisons = compared(twists, seed)
    along = SE2(theta=TRUE.theta).inverse().rotation()[:, 0]
    free = np.zeros((3, 3))
    free[:2, :2] = 1e4 * np.outer(along, along)
    straight = [each._replace(covariance=each.covariance + free) for each in comparisons]
    assert estimate_relative_pose(straight, TRUE).observable.tolist() == [False, True, True, False]
    assert estimate_relative_pose(straight[:100] + comparisons[100:], TRUE).observable.all()


def test_the_motion_of_the_first_lidar_is_interpolated():
    """A drive along an arc at 12.5 Hz, with a gap."""
    first, twist = FirstLidar(), np.array([0.5, 0.0, 0.4])

    def pose(stamp):
        angle = twist[2] * stamp * 1e-9
        radius = twist[0] / twist[2]
        return SE2(radius * math.sin(angle), radius * (1.0 - math.cos(angle)), angle)
    assert first.motion_at(0) is None and not first.is_heard(0)
    for stamp in range(0, 2_000_000_000, 80_000_000):
        first.add(stamp, pose(stamp))
    stamp = 1_030_000_000
    motion = first.motion_at(stamp)
    assert np.allclose(motion.pose.as_array(), pose(stamp).as_array(), atol=1e-3)
    assert np.allclose(motion.twist, twist, atol=2e-3)
    assert first.motion_at(HALF_SPAN // 2) is None
    last = 1_920_000_000
    assert first.must_wait(last) and not first.must_wait(stamp) and not first.must_wait(last + 600_000_000)
    first.add(4_000_000_000, pose(0))
    assert first.motion_at(last) is None and first.is_heard(4_100_000_000)
    first.add(3_000_000_000, pose(0))
    assert not first.is_heard(4_000_000_000) and first.motion_at(3_000_000_000) is None
