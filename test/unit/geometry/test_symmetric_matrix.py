# SPDX-License-Identifier: Apache-2.0
"""Symmetric 3 x 3 matrices against numpy's linear algebra."""
import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.symmetric_matrix import inverse, mahalanobis


def matrices(count=200):
    """Positive definite, with eigenvalues from 1e-4 to 1e4."""
    rng = np.random.default_rng(0)
    for _ in range(count):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        yield axes @ np.diag(10.0 ** rng.uniform(-4.0, 4.0, 3)) @ axes.T


def test_inverse_is_numpys_and_symmetric_to_the_last_bit():
    for matrix in matrices():
        found = inverse(matrix)
        assert (found == found.T).all()
        np.testing.assert_allclose(found, np.linalg.inv(matrix), rtol=1e-7, atol=1e-9 * np.abs(found).max())


def test_a_covariance_with_a_degenerate_direction_has_an_inverse():
    """10 m along, 1 mm across, 0.01 deg."""
    turn = np.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    covariance = turn @ np.diag([100.0, 1e-6, 3e-8]) @ turn.T
    np.testing.assert_allclose(inverse(inverse(covariance)), covariance, rtol=1e-5, atol=1e-9)
    assert (np.linalg.eigvalsh(inverse(covariance)) > 0.0).all()


def test_a_singular_matrix_has_no_inverse():
    with pytest.raises(ZeroDivisionError):
        inverse(np.diag([1.0, 0.0, 2.0]))


def test_distance_of_an_error():
    rng = np.random.default_rng(1)
    for covariance in matrices(50):
        error = rng.normal(size=3)
        assert mahalanobis(error, covariance) == pytest.approx(error @ np.linalg.solve(covariance, error), rel=1e-7)
