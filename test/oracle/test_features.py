# SPDX-License-Identifier: Apache-2.0
"""Compiled steps of the feature extraction against their definitions, slow and beam by beam."""
import dataclasses
import itertools
import math

import numpy as np
import pytest
from compiled_inputs import SIZES, oriented_points, scan_points

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.noise import estimate_noise
from dbscan_reg_ros.core.features.oriented_points import OrientedPoints, high_leverage, leverage
from dbscan_reg_ros.core.features.ring_band import Outcome, ring_band_filter
from dbscan_reg_ros.core.features.surfaces import NORMAL_NOISE, estimate_normals, find_breaks
from dbscan_reg_ros.core.features.tables import build_free_space_profile, build_likelihood_field
from dbscan_reg_ros.core.geometry.se2 import as_complex, as_vectors
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.scan import Scan

P = Parameters()
RNGS = pytest.mark.parametrize('seed', range(3))


@RNGS
@pytest.mark.parametrize('size', [9, 180, 1081])
def test_the_noise_is_a_quantile_of_the_second_differences(seed, size):
    ranges = np.abs(np.random.default_rng(seed).normal(3.0, 0.02, size))
    limits = dataclasses.replace(P.scan, noise_min=1e-4, noise_max=1.0)
    bend = np.sort(np.abs(ranges[1:-1] - 0.5 * (ranges[2:] + ranges[:-2])))
    # 0.38532 is the quantile 0.3 of |N(0, 1)|, and sqrt(1.5) the noise of a second difference.
    expected = bend[int(0.3 * len(bend))] / (0.38532 * math.sqrt(1.5))
    assert estimate_noise(ranges, limits) == pytest.approx(expected, rel=1e-12)


def on_line(points, third, first, second, noise):
    """Whether a beam meets the line through two others near its own return, and how far from it [m] (Eq. 3)."""
    a, p, q = (complex(*points[k]) if 0 <= k < len(points) else complex(math.nan) for k in (third, first, second))
    across = (a.conjugate() * (q - p)).imag
    distance = abs((p.conjugate() * q).imag / across - 1.0) * abs(a) if across else math.inf
    growth = 1.0 + (abs(first - third) + abs(second - third)) / (second - first)
    distance = math.inf if math.isnan(distance) else distance
    return distance <= 0.01 * abs(a) + 3.0 * noise * growth, distance


def defined_outcome(points, noise, gross):
    """The outcome of each beam by the definition of the filter; every return has a neighbour."""
    size, ring = len(points), range(-3, 4)
    astride = [on_line(points, k, k - 1, k + 1, noise)[0] for k in range(size)]
    deviation = {}
    for k in range(size):
        corner = 2 <= k < size - 2 and astride[k - 2] and astride[k + 2]
        pairs = [(k + a, k + b) for a, b in itertools.combinations(ring, 2) if a and b]
        lines = {(i, j): on_line(points, k, i, j, noise) for i, j in pairs}
        on = any(found for (i, j), (found, _) in lines.items() if not (corner and i < k < j))
        if not on and math.isfinite(points[k, 0]):
            deviation[k] = min(distance for _, distance in lines.values())
    outcome = np.zeros(size, dtype=int)
    for k, off in deviation.items():
        inner = outer = 1
        for other in (k + a for a in ring if a):
            side = [k + a for a in ring if (a < 0) != (other < k) and a]
            lines = [on_line(points, other, i, j, noise) for i, j in itertools.combinations(side, 2)]
            if any(math.isfinite(distance) for _, distance in lines) and not any(found for found, _ in lines):
                outer += 1
                inner += abs(other - k) == 1
        whole = 0 < k < size - 1 and np.isfinite(points[k - 1:k + 2]).all()
        if inner >= 2 or off > gross:
            outcome[k] = Outcome.REMOVED
        elif outer >= 3:
            outcome[k] = Outcome.CORNER
        elif whole:
            outcome[k] = Outcome.SMOOTHED
    return outcome


@RNGS
@pytest.mark.parametrize('gross', [0.05, 0.5])
def test_the_ring_band_filter_is_its_definition(seed, gross):
    points = scan_points(np.random.default_rng(seed), 120)
    known = np.isfinite(points[:, 0])
    if 2 * np.count_nonzero(known[1:] & known[:-1]) < np.count_nonzero(known) - 1:
        points = points[known]
    filtered, outcome = ring_band_filter(points, 0.01, dataclasses.replace(P.filter, gross_error=gross))
    np.testing.assert_array_equal(outcome, defined_outcome(points, 0.01, gross))
    assert len(set(outcome.tolist())) > 1
    for k in np.flatnonzero(outcome == Outcome.SMOOTHED):
        np.testing.assert_allclose(filtered[k], points[k - 1:k + 2].mean(axis=0))
    assert np.isnan(filtered[outcome == Outcome.REMOVED]).all()


@RNGS
@pytest.mark.parametrize('increment', [0.02, -0.02])
def test_surfaces_end_where_eq_5_says_and_normals_are_those_of_their_windows(seed, increment):
    rng = np.random.default_rng(seed)
    measured = scan_points(rng, 300)
    beams = np.flatnonzero(np.isfinite(measured[:, 0]))
    points, noise = as_complex(measured[beams]), rng.uniform(0.0, 0.05, len(beams))
    breaks = find_breaks(points, beams, increment, 0.01, P.segments)
    for k in range(len(points) - 1):
        gap, nearer = beams[k + 1] - beams[k], min(abs(points[k]), abs(points[k + 1]))
        limit = P.segments.breakpoint_factor * abs(increment) * gap * nearer + P.segments.breakpoint_noise * 0.01
        assert breaks[k] == (gap > P.segments.max_gap or abs(points[k + 1] - points[k]) >= limit)
    normals = estimate_normals(points, breaks, increment, noise, P.segments)
    surface = np.concatenate(([0], np.cumsum(breaks)))
    for k in np.flatnonzero(normals):
        near = [i for i in range(k - 2, k + 2 + 1)
                if 0 <= i < len(points) and surface[i] == surface[k]]
        assert abs(normals[k]) == pytest.approx(1.0)
        if len(near) == 5:
            # The window has at least these points: the normal is that of all of them if the reach adds none.
            reach = max(0.1, NORMAL_NOISE * noise[k])
            beyond = points[[near[0] - 1, (near[-1] + 1) % len(points)]]
            if np.abs(beyond - points[k]).max() > 2.0 * reach:
                own = np.stack((points[near].real, points[near].imag), axis=1)
                across = np.linalg.svd(own - own.mean(axis=0))[2][1]
                assert abs(complex(*across) * normals[k].conjugate()) == pytest.approx(1.0)


@RNGS
@pytest.mark.parametrize('size', [*SIZES, 300])
def test_the_leverage_is_the_diagonal_of_the_hat_matrix(seed, size):
    points = oriented_points(np.random.default_rng(seed), size)
    rows = np.stack((points.normals.real, points.normals.imag), axis=1)
    mean = rows.T @ rows / max(size, 1)
    for weights in (points.weights, None, np.zeros(size)):
        hat = np.einsum('ni,ij,nj->n', rows, np.linalg.inv(mean + np.eye(2)), rows)
        hat = hat if weights is None else hat * weights
        found = leverage(OrientedPoints(points.points, points.normals, points.beams, weights))
        np.testing.assert_allclose(found, hat / max(hat.sum(), 1e-300), atol=1e-12)
    if size > 2:
        hat = np.einsum('ni,ij,nj->n', rows, np.linalg.inv(mean), rows)
        sure = np.abs(hat - 4.0) > 1e-9
        np.testing.assert_array_equal(high_leverage(points.normals)[sure], (hat > 4.0)[sure])


def test_points_without_a_normal_are_no_oriented_points():
    features = extract_features(Scan.from_points(scan_points(np.random.default_rng(0), 180)))
    known, found = features.normals.any(axis=1), features.wall_points
    assert 0 < len(found) < len(features.points)
    assert found.points.tolist() == as_complex(features.points[known]).tolist()
    assert found.normals.tolist() == as_complex(features.normals[known]).tolist()
    assert found.beams.tolist() == features.beams[known].tolist()


@pytest.mark.parametrize('seed, size', [(0, 1), (1, 2), (2, 180), (3, 70_000)])
def test_a_cell_of_the_likelihood_field_has_the_nearest_point(seed, size):
    """Up to the quarter of a cell by which points in one cell differ; farther than the reach there is none."""
    rng = np.random.default_rng(seed)
    points = oriented_points(rng, size)
    field = build_likelihood_field(points, P.density)
    at = rng.uniform(-8.0, 8.0, (200, 2)) @ (1.0, 1j)
    found = field.nearest(at)
    distance = np.abs(points.points - at[:, None])
    reach, cell = P.density.max_distance, field.cell
    assert (found[distance.min(axis=1) > reach + 2.0 * cell] == size).all()
    near = distance.min(axis=1) < reach - 2.0 * cell
    assert (found[near] < size).all()
    excess = distance[near, found[near]] - distance[near].min(axis=1)
    assert excess.max(initial=0.0) < 2.0 * cell
    step = np.abs(np.diff(points.points))
    gaps = np.minimum(np.append(step, np.inf), np.append(np.inf, step)) if size > 1 else np.full(size, np.inf)
    np.testing.assert_allclose(field.extents[:-1], np.maximum(gaps, cell))


@RNGS
@pytest.mark.parametrize('size', [1, 7, 180, 1081])
def test_a_bin_of_the_free_space_profile_has_the_ranges_of_the_beams_that_touch_it(seed, size):
    rng = np.random.default_rng(seed)
    bearing, radius = np.sort(rng.uniform(-math.pi, math.pi, size)), rng.uniform(0.5, 5.0, size)
    increment = 2.0 * math.pi / max(size, 100)
    found = build_free_space_profile(np.stack((np.cos(bearing), np.sin(bearing)), axis=1) * radius[:, None], increment)
    count = len(found.near)
    around, ranges = np.concatenate([bearing + turn for turn in (-2 * math.pi, 0, 2 * math.pi)]), np.tile(radius, 3)
    for k in range(count):
        low, high = -math.pi + 2.0 * math.pi * k / count, -math.pi + 2.0 * math.pi * (k + 1) / count
        before, after = np.flatnonzero(around <= low).max(), np.flatnonzero(around >= high).min()
        if around[after] - around[before] < 3.0 * increment - 1e-9:
            assert found.near[k] == pytest.approx(ranges[before:after + 1].min())
            assert found.far[k] == pytest.approx(ranges[before:after + 1].max())
        elif around[after] - around[before] > 3.0 * increment + 1e-9:
            assert found.near[k] == found.far[k] == 0.0


@pytest.mark.parametrize('increment, count', [(0.5, 60), (math.radians(-2.0), 180), (1e-4, 2880)])
def test_the_resolution_of_a_profile_is_that_of_the_beams_within_limits(increment, count):
    around = 2.0 * np.exp(1j * np.radians(np.arange(-179.5, 180.0)))
    assert len(build_free_space_profile(as_vectors(around), increment).near) == count
