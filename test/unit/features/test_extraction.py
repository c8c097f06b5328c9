# SPDX-License-Identifier: Apache-2.0
"""What is kept of a scan: noise and normals."""
import copy
import math
import pickle

import numpy as np
import pytest
from rooms import DEGREE, FULL, L_ROOM, look, outline

from dbscan_reg_ros import Parameters, Scan, ScanGeometry
from dbscan_reg_ros.core.features import surfaces
from dbscan_reg_ros.core.features.extraction import extract_features, extract_from_returns
from dbscan_reg_ros.core.features.noise import estimate_noise
from dbscan_reg_ros.core.features.poles import with_poles
from dbscan_reg_ros.core.features.returns import Returns, deskew
from dbscan_reg_ros.core.parameters.features import ScanParameters

PLAIN = Parameters().replace({'advanced.filter.test': 'off'})


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_normals_are_those_of_the_walls_and_face_the_sensor(sign):
    geometry = ScanGeometry(-sign * math.pi, sign * DEGREE, 360)
    found = extract_features(look(outline(L_ROOM), geometry=geometry), PLAIN)
    assert (np.einsum('pi,pi->p', found.points, found.normals) <= 0.0).all()
    known = found.normals.any(axis=1)
    assert known.mean() > 0.9
    assert np.hypot(*found.normals[known].T) == pytest.approx(1.0)
    # All walls are parallel to an axis; only around the six corners a normal belongs to both.
    straight = np.abs(found.normals).min(axis=1) < 1e-6
    assert straight[known].mean() > 0.8


@pytest.mark.parametrize(('reach', 'biased'), [(4.0, False), (0.0, True)])
def test_normals_reach_as_far_as_the_noise_asks(reach, biased, monkeypatch):
    """Noise lies along the beams.

    Fitted to little more than the noise, the normals of a wall turn towards the sensor.
    """
    walls = np.array([[(-60.0, -1.1), (60.0, -1.1)], [(60.0, 1.1), (-60.0, 1.1)]])
    monkeypatch.setattr(surfaces, 'NORMAL_NOISE', reach)
    turned = []
    for seed in range(20):
        found = extract_features(look(walls, geometry=FULL, noise=0.05, seed=seed), PLAIN)
        bearing = np.arctan2(found.points[:, 1], found.points[:, 0])
        aside = found.normals.any(axis=1) & (np.radians(30.0) < bearing) & (bearing < np.radians(60.0))
        turned.append(np.arctan2(found.normals[aside, 0], -found.normals[aside, 1]))
    assert (abs(np.degrees(np.concatenate(turned).mean())) > 5.0) == biased


def test_the_noise_that_is_kept_is_that_of_what_the_filter_leaves():
    """A fifth of the beams is wrong: a second difference in two."""
    rng = np.random.default_rng(0)
    for sigma in (0.005, 0.01):
        ranges = look(outline(L_ROOM)).ranges + rng.normal(0.0, sigma, 360)
        wrong = rng.random(360) < 0.2
        ranges[wrong] = rng.uniform(0.2, 6.0, np.count_nonzero(wrong))
        kept = extract_features(Scan(0, ranges, FULL)).noise
        assert kept < 0.8 * estimate_noise(ranges, ScanParameters())
        assert kept == pytest.approx(sigma, rel=0.5)


def test_ranges_beyond_the_parameters_limits_are_left_out_and_the_limits_are_not():
    ranges = np.where(np.arange(360) < 120, 1.0, np.where(np.arange(360) < 240, 2.0, 4.0))
    scan = Scan(0, ranges, FULL)

    def left(**limits):
        found = extract_features(scan, PLAIN.replace({f'scan.{name}': value for name, value in limits.items()}))
        return found.beams.min(), found.beams.max(), len(found.beams)

    assert left() == left(range_min=1.0, range_max=4.0) == (0, 359, 360)
    assert left(range_min=1.5, range_max=3.0) == (120, 239, 120)


def test_features_can_be_copied_at_any_moment_and_not_be_changed():
    features = with_poles(extract_features(look(outline(L_ROOM), geometry=FULL, noise=0.01)), 0.3, PLAIN.segments)
    weighted = features.downweighted(np.arange(20), 0.5)
    for each in (features, weighted, weighted.without(np.arange(len(weighted.oriented_points)) % 3 == 0)):
        for _ in range(2):  # before and after its points and tables were made
            for copied in (copy.copy(each), copy.deepcopy(each), pickle.loads(pickle.dumps(each))):
                assert repr(copied) == repr(each) and copied.isolated == each.isolated
                assert np.array_equal(copied.oriented_points.points, each.oriented_points.points)
                assert np.array_equal(copied.leverage, each.leverage)
                assert np.array_equal(copied.segments.fixed_ends, each.segments.fixed_ends)
            assert len(each.likelihood_field.offsets) > len(each.free_space.near) / 4
    for array in (features.points, features.normals, features.beams, features.breaks, weighted.weights):
        with pytest.raises(ValueError, match='read-only'):
            array[0] = 0
    with pytest.raises(AttributeError):
        features.noise = 0.0


def test_features_are_those_of_the_deskewed_scan_and_keep_what_was_measured():
    scan, twist = look(outline(L_ROOM), geometry=FULL), np.array([0.5, 0.1, 0.8])
    scan = Scan(scan.stamp, np.where(np.arange(360) % 9 == 0, np.inf, scan.ranges), FULL, 0.1 / 360)
    returns = Returns(scan, ScanParameters(), twist)
    np.testing.assert_allclose(returns.points, deskew(scan, twist).points, atol=1e-5)
    features = extract_from_returns(returns, PLAIN, 0.0)
    assert features.measured is scan and features.scan.time_increment == 0.0
    np.testing.assert_allclose(features.scan.points[features.beams], features.points, atol=1e-5)
    assert extract_features(scan).scan is scan
