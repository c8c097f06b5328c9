# SPDX-License-Identifier: Apache-2.0
"""DBSCAN and its k-dist graph, sample for sample against scikit-learn."""

import numpy as np
import pytest
from sklearn.cluster import DBSCAN
from sklearn.neighbors import NearestNeighbors

from dbscan_reg_ros.core.registration.clustering.clusters import dbscan_plane as dbscan_of_complex
from dbscan_reg_ros.core.registration.clustering.rotation import dbscan_circle, k_distances

SEEDS = range(3)
FAR = 1e6
"""Circumference of a circle on which numbers are as on a line."""


def dbscan_line(samples, sigma, min_samples, period=FAR):
    return dbscan_circle(samples, sigma, min_samples, period)


def dbscan_plane(samples, sigma, min_samples):
    return dbscan_of_complex(samples[:, 0] + 1j * samples[:, 1], sigma, min_samples)


def expected(samples, sigma, min_samples, period=None):
    """Labels by scikit-learn; on a circle from the table of distances."""
    samples = np.asarray(samples, dtype=float).reshape(len(samples), -1)
    if period is None:
        return DBSCAN(eps=sigma, min_samples=min_samples).fit_predict(samples)
    apart = np.abs(samples - samples.T)
    around = np.minimum(apart, period - apart)
    return DBSCAN(eps=sigma, min_samples=min_samples, metric='precomputed').fit_predict(around)


def drawn(seed, dimensions=1):
    """Random samples with clusters and noise, sigma and MinPts."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(2, 300))
    centres = rng.uniform(-3.0, 3.0, (6, dimensions))
    samples = centres[rng.integers(0, 6, size)] + rng.normal(0.0, 0.15, (size, dimensions))
    loose = rng.random(size) < 0.2
    samples[loose] = rng.uniform(-3.1, 3.1, (loose.sum(), dimensions))
    samples = np.clip(samples, -3.1, 3.1)
    return samples, float(rng.choice([0.02, 0.05, 0.2])), int(rng.integers(1, 9)), rng


@pytest.mark.parametrize('seed', SEEDS)
def test_angles_are_clustered_round_the_circle(seed):
    samples, sigma, min_samples, rng = drawn(seed)
    period = 2.0 * np.pi
    angles = (samples[:, 0] + rng.uniform(0.0, period) + np.pi) % period - np.pi
    np.testing.assert_array_equal(dbscan_line(angles, sigma, min_samples, period=period),
                                  expected(angles, sigma, min_samples, period=period))


@pytest.mark.parametrize('seed', SEEDS)
def test_duplicates_and_distances_equal_to_sigma(seed):
    """Whole numbers: many samples coincide, many are exactly sigma apart."""
    rng = np.random.default_rng(seed)
    samples = rng.integers(0, 40, (int(rng.integers(1, 60)), 2)).astype(float)
    for sigma in (1.0, 2.0, 5.0):
        for min_samples in (1, 3):
            np.testing.assert_array_equal(dbscan_line(samples[:, 0], sigma, min_samples),
                                          expected(samples[:, 0], sigma, min_samples))
            np.testing.assert_array_equal(dbscan_line(samples[:, 0], sigma, min_samples, period=40.0),
                                          expected(samples[:, 0], sigma, min_samples, period=40.0))
            np.testing.assert_array_equal(dbscan_plane(samples, sigma, min_samples),
                                          expected(samples, sigma, min_samples))


def test_a_border_sample_goes_to_the_first_cluster_that_reaches_it():
    samples = np.array([3.0, 3.5, 4.0, 2.0, 1.0, 0.5, 0.0])
    found = dbscan_line(samples, 1.0, 4)
    np.testing.assert_array_equal(found, expected(samples, 1.0, 4))
    np.testing.assert_array_equal(dbscan_plane(np.column_stack((samples, 0.0 * samples)), 1.0, 4), found)


def test_a_sigma_of_half_the_circle_reaches_every_sample_once():
    samples = np.array([-2.0, 0.0, 2.0])
    np.testing.assert_array_equal(dbscan_line(samples, 3.2, 3, period=2.0 * np.pi), [0, 0, 0])
    np.testing.assert_array_equal(dbscan_line(samples, 3.2, 4, period=2.0 * np.pi), [-1, -1, -1])


@pytest.mark.parametrize('k', [1, 2, 5])
def test_k_distances_are_those_to_the_kth_nearest_neighbour_largest_first(k):
    for seed in SEEDS:
        samples, _, _, _ = drawn(seed)
        size = min(k, len(samples) - 1)
        nearest = NearestNeighbors(n_neighbors=size + 1).fit(samples).kneighbors(samples)[0][:, -1]
        np.testing.assert_allclose(k_distances(samples[:, 0], k), np.sort(nearest)[::-1], atol=1e-12)


def test_k_distances_of_no_sample_and_one_sample():
    assert len(k_distances(np.empty(0), 1)) == 0
    np.testing.assert_array_equal(k_distances(np.array([3.0]), 2), [0.0])
    np.testing.assert_array_equal(k_distances(np.array([3.0, 4.0]), 5), [1.0, 1.0])
