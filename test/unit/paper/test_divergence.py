# SPDX-License-Identifier: Apache-2.0
"""Kernel densities and K-L divergence (Eq. 16-21)."""
import math

import numpy as np
import pytest
from rooms import L_ROOM, look, outline
from scipy.stats import gaussian_kde

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.paper.divergence import divergences, log_density, shifted_divergences, silverman


def coordinates(seed, size=180):
    """Two lumps and a flat part, as the walls of a room make them."""
    rng = np.random.default_rng(seed)
    return np.concatenate((rng.normal(-2.0, 0.05, size // 3), rng.normal(3.0, 0.1, size // 3),
                           rng.uniform(-2.0, 3.0, size - 2 * (size // 3))))


def oracle(samples, bandwidth):
    return gaussian_kde(samples, bandwidth / np.std(samples, ddof=1))


@pytest.mark.parametrize('bandwidth', [0.05, 0.3])
def test_the_density_is_that_of_scipy(bandwidth):
    samples, at = coordinates(0), np.linspace(-4.0, 5.0, 300)
    found = log_density(samples, bandwidth, at)
    np.testing.assert_allclose(found, oracle(samples, bandwidth).logpdf(at), atol=1e-9)
    np.testing.assert_allclose(np.exp(found), oracle(samples, bandwidth)(at), atol=1e-12)


def test_silvermans_rule_is_that_of_scipy():
    for seed in range(5):
        samples = coordinates(seed, 100 + 50 * seed)
        kernel = gaussian_kde(samples, 'silverman')
        assert silverman(samples) == pytest.approx(math.sqrt(kernel.covariance[0, 0]))
    assert silverman(np.ones(20)) == 1e-3


def summed(p, q, step):
    """Eq. 19-21, term by term."""
    return (sum(a * math.log(a / b) for a, b in zip(p, q, strict=True))
            + sum(b * math.log(b / a) for a, b in zip(p, q, strict=True))) * step


@pytest.mark.parametrize('bandwidth', [0.1, 0.3])
def test_the_divergence_of_every_shift_is_the_sum_of_the_paper(bandwidth):
    reference, current = coordinates(0), coordinates(1, 150)
    shifts = np.array([-0.4, -0.05, 0.0, 0.001, 0.3])
    found = shifted_divergences(reference, current, shifts, bandwidth)
    low = min(reference.min(), current.min() - 0.4) - 3.0 * bandwidth
    high = max(reference.max(), current.max() + 0.3) + 3.0 * bandwidth
    at = np.linspace(low, high, 200)
    q = oracle(reference, bandwidth)(at)
    expected = [summed(oracle(current + shift, bandwidth)(at), q, at[1] - at[0]) for shift in shifts]
    np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_equal_sets_do_not_diverge_and_others_do_the_more_the_farther_apart():
    samples = coordinates(2)
    shifts = np.array([0.0, 0.001, 0.01, 0.1, 0.5, 1.0])
    found = shifted_divergences(samples, samples, shifts, 0.2)
    assert found[0] == pytest.approx(0.0, abs=1e-9)
    assert (np.diff(found) > 0.0).all()
    np.testing.assert_allclose(shifted_divergences(samples, samples, -shifts, 0.2)[1:], found[1:], rtol=0.3)


def test_the_true_motion_diverges_least_of_all_candidates():
    motion = SE2(-1.5, 0.8, 0.3)
    current = look(outline(L_ROOM)).points
    rng = np.random.default_rng(0)
    candidates = motion.as_array() + rng.uniform(-0.3, 0.3, (200, 3)) * (1.0, 1.0, 0.0)
    candidates = np.concatenate((candidates, candidates + np.array((0.0, 0.0, 0.1)), -candidates))
    candidates[77] = motion.as_array()
    found = divergences(candidates, motion.apply(current), current)
    assert np.argmin(found) == 77
    assert found[77] == pytest.approx(0.0, abs=1e-6)
