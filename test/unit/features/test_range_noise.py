# SPDX-License-Identifier: Apache-2.0
"""How noisy the ranges of a scan are, and what noisy points count."""
import dataclasses
import math

import numpy as np
import pytest
from l_room import linear_residuals
from rooms import DEGREE, FULL, L_ROOM, look, outline

from dbscan_reg_ros import SE2, Parameters, Prior, ScanGeometry
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.noise import estimate_noise, estimate_noise_ratio
from dbscan_reg_ros.core.features.oriented_points import OrientedPoints
from dbscan_reg_ros.core.odometry.models.noise_history import NoiseRatioHistory
from dbscan_reg_ros.core.parameters.features import ScanParameters
from dbscan_reg_ros.core.registration.fit import fit
from dbscan_reg_ros.core.registration.pipeline import register, register_within_gate
from dbscan_reg_ros.core.registration.point_to_line import refine
from dbscan_reg_ros.core.registration.residuals import Alignment

LIMITS = ScanParameters()


@pytest.mark.parametrize('sigma', [0.005, 0.02, 0.05])
def test_the_noise_is_that_of_the_ranges_in_spite_of_corners_and_outliers(sigma):
    rng = np.random.default_rng(0)
    limits = ScanParameters(noise_min=0.0001, noise_max=1.0)
    noise = rng.normal(0.0, sigma, 4000)
    assert estimate_noise(3.0 + 0.01 * np.arange(4000) + noise, limits) == pytest.approx(sigma, rel=0.06)
    wild = np.where(rng.random(4000) < 0.03, 5.0, 3.0) + noise
    assert estimate_noise(wild, limits) == pytest.approx(sigma, rel=0.15)


def test_the_noise_keeps_within_its_limits():
    limits = ScanParameters(noise_min=0.002, noise_max=0.03)
    assert estimate_noise(np.full(100, 2.0), limits) == 0.002
    assert estimate_noise(np.tile([1.0, 5.0], 50), limits) == estimate_noise(np.full(7, 2.0), limits) == 0.03


def along_a_wall(noise, ratio, seed=0, uneven=0.0):
    """Points of a wall 1 m aside, 1 m to 10 m away, a degree from beam to beam, within `uneven` [rad]."""
    rng, bearing = np.random.default_rng(seed), np.arange(-84, 85) * DEGREE
    bearing = bearing + uneven * rng.uniform(-1.0, 1.0, len(bearing))
    ranges = 1.0 / np.cos(bearing)
    ranges += rng.normal(0.0, np.maximum(noise, ratio * ranges))
    return ranges * np.exp(1j * bearing)


def ratio_in(points, limits=LIMITS, every=1):
    of_beams = np.full(every * len(points), complex(np.nan, np.nan))
    of_beams[::every] = points
    return estimate_noise_ratio(of_beams, np.abs(of_beams), limits)


def ratios(noise, ratio, limits=LIMITS, uneven=0.0):
    return np.array([ratio_in(along_a_wall(noise, ratio, seed, uneven), limits) for seed in range(200)])


@pytest.mark.parametrize('ratio', [0.01, 0.02, 0.04])
def test_noise_proportional_to_the_range_is_found_as_a_ratio(ratio):
    found = ratios(0.0, ratio)
    assert np.median(found) == pytest.approx(ratio, rel=0.05)
    assert np.mean(found == 0.0) < 0.2, 'of 169 beams: usual, not always'


def test_constant_noise_gives_no_ratio_and_neither_does_a_bent_wall():
    assert np.mean(ratios(0.01, 0.0) == 0.0) > 0.9
    assert np.abs(np.diff(np.abs(along_a_wall(0.0, 0.0)), 2)).max() > 0.3
    assert ratios(0.0, 0.0).max() < 1e-9


def test_outliers_are_no_noise():
    found = []
    for seed in range(200):
        points, rng = along_a_wall(0.01, 0.0, seed), np.random.default_rng(seed)
        wild = rng.random(len(points)) < 0.3
        found.append(ratio_in(np.where(wild, rng.uniform(0.2, 10.0, len(points)) * points / np.abs(points), points)))
    assert np.mean(found) < 0.001
    assert np.mean(np.array(found) > 0.0) < 0.1


def test_the_ratio_keeps_within_its_limit_and_needs_neighbouring_points():
    assert ratios(0.0, 0.04, ScanParameters(noise_ratio_max=0.03)).max() == 0.03
    assert ratios(0.0, 0.04, ScanParameters(noise_ratio_max=0.0)).max() == 0.0
    points = along_a_wall(0.0, 0.04)
    assert ratio_in(points, every=2) == ratio_in(points[:17]) == ratio_in(points[:0]) == 0.0


@pytest.mark.parametrize('search', [register, register_within_gate])
def test_noise_that_one_of_two_scans_shows_is_chance(search):
    one, other = (extract_features(look(outline(L_ROOM), SE2(0.05 * k), FULL, 0.01, k)) for k in range(2))
    prior = Prior(SE2(0.05), np.diag((0.1, 0.1, 0.1)) ** 2)

    def found(before, after):
        return search(one.with_noise_ratio(before), other.with_noise_ratio(after), Parameters(), prior)

    np.testing.assert_array_equal(found(0.0, 0.05).covariance, found(0.0, 0.0).covariance)
    assert found(0.05, 0.05).weakest_information < 0.9 * found(0.0, 0.0).weakest_information


def test_the_noise_ratio_of_a_sensor_is_that_of_nearly_all_its_scans():
    def usual(ratios):
        known, values = NoiseRatioHistory(), []
        for ratio in ratios:
            known = known.after(ratio)
            values.append(known.value)
        return values

    assert usual([0.01] * 50 + [0.05] * 10) == [0.01] * 60, 'clutter in a few scans'
    assert usual((0.0, 0.0, 0.03, 0.0, 0.03) * 10)[-20:] == [0.0] * 20


def test_errors_of_noisy_points_count_in_units_of_their_noise():
    """Six walls; of the points on one side an error counts a third.

    Least squares with those weights, as numpy solves it.
    """
    features = extract_features(look(outline(L_ROOM), geometry=FULL))
    cloud, surface = features.sampled_points, features.likelihood_field
    rng = np.random.default_rng(0)
    inverse_noise = np.where(cloud.points.real > 0.0, 1.0 / 3.0, 1.0)
    points = cloud.points + rng.normal(0.0, 0.005, len(cloud))
    noisy, plain = (OrientedPoints(points, cloud.normals, cloud.beams, cloud.weights, noise)
                    for noise in (inverse_noise, None))
    still = np.zeros((1, 3))
    sharp, blunt = (fit(still[0], each, surface) for each in (noisy, plain))
    rows = linear_residuals(blunt)
    assert linear_residuals(sharp) == pytest.approx(rows * inverse_noise, abs=1e-12)
    assert (sharp.alike == blunt.alike).all()
    found, _ = refine(still, Alignment(noisy, surface, 0.0), [100.0])
    rows = rows * (inverse_noise * blunt.alike)
    step, *_ = np.linalg.lstsq(rows[:3].T, -rows[3], rcond=None)
    assert found[0] == pytest.approx(step, abs=1e-6)
    unweighted, _ = refine(still, Alignment(plain, surface, 0.0), [100.0])
    assert np.abs(found[0] - unweighted[0]).max() > 1e-4


def test_far_walls_are_as_straight_as_their_noise_lets_them_be():
    """A hall of 16 m by 12 m, ranges off by 3 %.

    With the same noise for every range, its walls break into pieces and its normals scatter.
    """
    hall_walls, rng = outline([(-8.0, -6.0), (8.0, -6.0), (8.0, 6.0), (-8.0, 6.0)]), np.random.default_rng(0)
    clean = look(hall_walls, geometry=ScanGeometry(-math.pi, 0.5 * DEGREE, 720))
    scan = dataclasses.replace(clean, ranges=clean.ranges * (1.0 + 0.03 * rng.normal(size=720)))

    def straying(features):
        normals = np.abs(features.normals[features.normals.any(axis=1)])
        return np.median(np.arcsin(normals.min(axis=1)))

    with_ratio, without_ratio = extract_features(scan), extract_features(scan, noise_ratio=0.0)
    assert with_ratio.noise_ratio == pytest.approx(0.03, abs=0.006)
    assert straying(with_ratio) < 0.25 < 0.4 < straying(without_ratio)
    assert np.median(with_ratio.segments.length) > 3.0 > 1.0 > np.median(without_ratio.segments.length)
