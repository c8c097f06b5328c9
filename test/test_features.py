"""What is kept of a scan: noise, normals and how much these stray."""
import math

import numpy as np
import pytest
from rooms import DEGREE, FULL, L_ROOM, look, outline

from dbscan_reg_ros import Parameters, Scan, ScanGeometry
from dbscan_reg_ros.core.features import estimate_noise, estimate_normals, extract_features
from dbscan_reg_ros.core.line_fit import summed_moments
from dbscan_reg_ros.core.parameters import ScanParameters, SegmentParameters
from dbscan_reg_ros.core.se2 import as_complex

PLAIN = Parameters().replace({'filter.test': 'off'})


def normals_of(points, breaks=None, increment=DEGREE, **changes):
    points = np.asarray(points, dtype=float)
    breaks = np.zeros(len(points) - 1, dtype=bool) if breaks is None else np.asarray(breaks)
    return estimate_normals(as_complex(points), summed_moments(points), breaks, increment, SegmentParameters(**changes))


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


def test_a_window_grows_to_its_reach_and_to_its_beams():
    """A wall at y = 1 m with one point, at x = 0, that lies 3 mm nearer: who sees it has a normal that is not (0, -1)."""
    x = 0.04 * np.arange(20, -21, -1)
    wall = np.column_stack((x, np.where(np.abs(x) < 0.01, 0.997, 1.0)))
    for changes, seen in (({'normal_reach': 0.0, 'normal_beams': 1}, 1), ({'normal_reach': 0.0, 'normal_beams': 3}, 3),
                          ({'normal_reach': 0.21, 'normal_beams': 1}, 5)):
        normals, _ = normals_of(wall, **changes)
        turned = np.abs(normals[:, 0]) > 1e-6
        # The point itself is in the middle of its window, which is not turned.
        expected = (np.abs(np.arange(-20, 21)) <= seen) & (np.arange(-20, 21) != 0)
        assert turned.tolist() == expected.tolist(), changes


def test_a_point_with_fewer_than_three_neighbours_or_without_direction_has_no_normal():
    points = [(1.0, 1.0), (0.9, 1.0), (0.8, 1.0), (0.3, 2.0), (0.2, 2.0)]
    normals, _ = normals_of(points, [False, False, True, False])
    assert normals.tolist() == [pytest.approx([0.0, -1.0], abs=1e-9)] * 3 + [[0.0, 0.0]] * 2
    normals, _ = normals_of([(0.0, 2.0), (0.02, 2.02), (0.04, 2.0)], normal_beams=2)
    assert normals.tolist() == [[0.0, 0.0]] * 3


def test_stray_is_the_variance_of_a_fitted_direction():
    """Three points (-d, e), (0, -e), (d, e): the residual is 8/9 e^2 and the extent 2/3 d^2, with one degree of freedom."""
    d, e = 0.05, 0.001
    k = np.arange(41)
    _, stray = normals_of(np.column_stack((1.0 - d * k, 2.0 + e * (-1.0) ** k)), normal_reach=0.0, normal_beams=1)
    assert stray == pytest.approx(4.0 / 3.0 * (e / d) ** 2, rel=0.001)


def test_ranges_beyond_the_parameters_limits_are_left_out_and_the_limits_are_not():
    ranges = np.where(np.arange(360) < 120, 1.0, np.where(np.arange(360) < 240, 2.0, 4.0))
    scan = Scan(0, ranges, FULL)

    def left(**limits):
        found = extract_features(scan, PLAIN.replace({f'scan.{name}': value for name, value in limits.items()}))
        return found.beams.min(), found.beams.max(), len(found.beams)

    assert left() == left(range_min=1.0, range_max=4.0) == (0, 359, 360)
    assert left(range_min=1.5, range_max=3.0) == (120, 239, 120)
