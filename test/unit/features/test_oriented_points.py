# SPDX-License-Identifier: Apache-2.0
"""Points with normals: thinning, sampling and leverage."""
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.features.oriented_points import OrientedPoints, high_leverage, leverage, sample


def drawn(count, seed=0):
    """Points in a rectangle of 6 m x 4 m, facing anywhere."""
    rng = np.random.default_rng(seed)
    return OrientedPoints(rng.uniform(-2.0, 4.0, count) + 1j * rng.uniform(-3.0, 1.0, count),
                 np.exp(1j * rng.uniform(-math.pi, math.pi, count)), np.arange(count))


@pytest.mark.parametrize('count, kept', [(10, range(10)), (9, range(0, 10, 2)), (5, range(0, 10, 2)),
                                         (4, range(0, 10, 3))])
def test_points_are_thinned_evenly_to_a_maximum_number(count, kept):
    points = np.arange(10.0) + 0j
    assert OrientedPoints(points, points, np.arange(len(points))).thinned(count).points.real.tolist() == list(kept)


def test_a_sample_is_thinned_but_for_points_that_face_where_few_do():
    """A corridor of 40 points, of which two face along it."""
    normals = np.tile([1j, -1j], 20)
    normals[[7, 22]] = 1.0, -1.0
    cloud = OrientedPoints(np.arange(40.0) + 0j, normals, np.arange(40))
    assert sample(cloud, 10).beams.tolist() == [0, 4, 7, 8, 12, 16, 20, 22, 24, 28, 32, 36]
    assert sample(cloud, 40) is cloud


@pytest.mark.parametrize('balance', [0.001, 1.0])
def test_leverage_is_that_of_a_ridge_regression(balance):
    cloud = drawn(40)
    normals = np.column_stack((cloud.normals.real, cloud.normals.imag))
    hat = normals @ np.linalg.inv(normals.T @ normals / 40 + balance * np.eye(2)) @ normals.T
    assert leverage(cloud, balance) == pytest.approx(np.diag(hat) / np.trace(hat))


def test_where_nothing_counts_there_is_no_leverage():
    cloud = drawn(20)
    cloud = OrientedPoints(cloud.points, cloud.normals, cloud.beams, np.zeros(20))
    assert not leverage(cloud, 1.0).any()


@pytest.mark.parametrize('share', [0.05, 0.2, 0.3, 0.5])
def test_high_leverage_is_more_than_twice_the_mean_of_the_hat_matrix(share):
    rng = np.random.default_rng(5)
    angle = np.where(rng.random(200) < share, 0.0, 0.5 * np.pi) + np.pi * rng.integers(0, 2, 200) + rng.normal(0.3, 0.1,
                                                                                                               200)
    normals = np.column_stack((np.cos(angle), np.sin(angle)))
    hat = normals @ np.linalg.inv(normals.T @ normals) @ normals.T
    expected = np.diag(hat) > 2.0 * np.trace(hat) / 200
    assert np.array_equal(high_leverage(np.exp(1j * angle)), expected) and expected.any() == (share < 0.25)


def test_no_leverage_is_high_where_all_face_alike():
    assert not high_leverage(np.exp(1j * np.array([0.3, 0.3, 0.3 + np.pi]))).any() and not high_leverage(np.empty(0,
                                                                                                                  complex)).any()
