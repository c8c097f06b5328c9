# SPDX-License-Identifier: Apache-2.0
"""Covariances that are carried from scan to scan, against the errors of many simulated drives."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.models.propagation import CovariancePropagation, coordinate_covariance
from dbscan_reg_ros.core.registration.records import Prior

STEP, INTERVAL = SE2(0.2, 0.05, 0.3), 0.1
MATCHED = np.diag((0.002, 0.003, 0.001)) ** 2
SPREAD = np.diag((0.01, 0.01, 0.02)) ** 2
CHANGE = np.diag((0.006, 0.006, 0.01)) ** 2
NONE, ALL = np.zeros((3, 3)), np.eye(3)
ALONG_A_WALL = np.array([[0.1, 0.0, 0.0], [0.0, 0.9, 0.0], [0.0, 0.1, 0.9]])


def sigma(covariance):
    return np.sqrt(np.diagonal(covariance))


def test_no_speed_grows_without_bound():
    drift, still = CovariancePropagation(), SE2()
    for _ in range(2000):
        drift.propagate(still, INTERVAL, Prior(still, SPREAD, CHANGE))
    assert sigma(drift.twist) == pytest.approx(3 * [1.0], rel=1e-6)


def test_after_an_unknown_motion_pose_and_twist_are_unknown():
    drift = CovariancePropagation()
    drift.propagate(STEP, INTERVAL, Prior(STEP, SPREAD, CHANGE), ALL, MATCHED)
    drift.observe(np.array((0.0, 2.0, 0.1)))
    drift.add_unknown_motion(3.0)
    np.testing.assert_allclose(drift.pose, MATCHED)
    np.testing.assert_allclose(drift.unobserved, np.diag((6.0, 6.0, 3.0)) ** 2)
    np.testing.assert_array_equal(drift.twist, np.eye(3))


@pytest.mark.parametrize(('fractions', 'along'), [
    ([ALONG_A_WALL] * 8, None), ([ALONG_A_WALL] * 8, 0.4), ([ALL, NONE, NONE, ALONG_A_WALL, ALL, 0.5 * ALL] * 2, None)],
    ids=['a wall', 'a wall that ends', 'in turn'])
def test_the_errors_of_many_drives_are_as_large(fractions, along):
    rng = np.random.default_rng(5)
    size, key_frames = 40000, (3, 5)
    started = ALL if along is None else np.outer(*2 * [(math.cos(along), math.sin(along), 0.0)])
    back = STEP.inverse().adjoint()
    drift = CovariancePropagation()
    # An error is that of the estimate against the truth, in the estimate's own frame; rows are drives.
    pose, base, twist = np.zeros((size, 3)), np.zeros((size, 3)), rng.normal(size=(size, 3))
    of_key_frame = np.zeros((size, 3))
    kept = np.sqrt(1.0 - np.diagonal(CHANGE) / INTERVAL ** 2)
    for k, fraction in enumerate(fractions):
        drift.propagate(STEP, INTERVAL, Prior(STEP, SPREAD, CHANGE), fraction, MATCHED)
        pose, base = pose @ back.T, base @ back.T
        change = rng.normal(size=(size, 3)) * sigma(CHANGE)
        jitter = rng.normal(size=(size, 3)) * sigma(SPREAD - CHANGE)
        matched = rng.normal(size=(size, 3)) * sigma(MATCHED)
        going_on = INTERVAL * kept * twist + change
        found = (base + matched) @ fraction.T + (pose + going_on + jitter) @ (np.eye(3) - fraction).T
        twist = (found - pose - jitter @ (np.eye(3) - fraction).T - of_key_frame @ back.T @ fraction.T) / INTERVAL
        pose, of_key_frame = found, np.zeros((size, 3))
        if k in key_frames:
            drift.start_key_frame(along)
            # Its error against the key frames before; the match with all key frames does not contain it.
            error = (pose - base) @ started
            of_key_frame, base = rng.permutation(error), base + error
    for said, errors in ((drift.pose, pose), (drift.twist, twist)):
        whiten = np.linalg.inv(np.linalg.cholesky(said))
        assert whiten @ np.cov(errors.T) @ whiten.T == pytest.approx(np.eye(3), abs=5.0 / math.sqrt(size))


@pytest.mark.parametrize('seed', range(3))
def test_the_covariance_of_the_coordinates_is_that_of_arcs(seed):
    """A motion along a curve that no scan constrains ends beside its tangent."""
    rng = np.random.default_rng(seed)
    factor = rng.normal(size=(3, 3)) * ((2.0,), (1.0,), (0.1,))
    x, y, theta = rng.multivariate_normal(np.zeros(3), factor @ factor.T, 20000).T
    arc = (x + 1j * y) * (np.exp(1j * theta) - 1.0) / (1j * theta)
    errors = np.array((arc.real, arc.imag, theta))
    second_moment = errors @ errors.T / errors.shape[1]
    assert np.allclose(coordinate_covariance(factor @ factor.T), second_moment, rtol=0.05,
                       atol=0.05 * np.trace(second_moment))
