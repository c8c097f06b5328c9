# SPDX-License-Identifier: Apache-2.0
"""Compiled steps of the feature extraction against the reference."""
import dataclasses
import re

import numpy as np
import pytest
from accelerated_inputs import SIZES, assert_same, oriented_points, ranges, scan_points

from dbscan_reg_ros import Parameters, Scan, ScanError, extract_features
from dbscan_reg_ros.core.backend import REFERENCE
from dbscan_reg_ros.core.features.extraction import extract_from_returns
from dbscan_reg_ros.core.features.likelihood_field import build_likelihood_field
from dbscan_reg_ros.core.features.normals import estimate_normals
from dbscan_reg_ros.core.features.oriented_points import build_oriented_points, leverage
from dbscan_reg_ros.core.features.point_sequence import point_sequence
from dbscan_reg_ros.core.features.range_noise import estimate_noise, estimate_noise_ratio
from dbscan_reg_ros.core.features.returns import admitted_returns
from dbscan_reg_ros.core.features.ring_band import ring_band_filter
from dbscan_reg_ros.core.features.segments import extract_segments
from dbscan_reg_ros.core.features.small_objects import find_small_objects, with_poles
from dbscan_reg_ros.core.geometry.se2 import as_complex

P = Parameters()
NO_LIMITS = dataclasses.replace(P.scan, noise_min=1e-4, noise_max=1.0)


def returns(rng, size):
    points = scan_points(rng, size)
    beams = np.isfinite(points[:, 0]).nonzero()[0]
    return as_complex(points[beams]), beams


@pytest.mark.parametrize('size', [*SIZES, 9, 1081])
def test_range_noise(both, rng, size):
    points, beams = returns(rng, size)
    for limits in (P.scan, NO_LIMITS):
        both(estimate_noise, np.abs(points), limits)
        both(estimate_noise_ratio, points, np.abs(points), beams, limits)
    both(estimate_noise, np.zeros(size), NO_LIMITS)


@pytest.mark.parametrize('seed', [1, 2, 4, 7, 8])
def test_equal_ranges_of_a_lidar_have_the_same_noise_ratio_in_both(compiled, seed):
    """Ranges of whole decimetres: of many equal ones some belong to the nearer half and some to the farther one."""
    angles = np.linspace(-1.4, 1.4, 181)
    noise = np.random.default_rng(seed).normal(1.0, 0.04, len(angles))
    returns = (admitted_returns(Scan.from_ranges(np.round(noise / np.cos(angles), 1), angles), P.scan, backend)
               for backend in (REFERENCE, compiled))
    expected, found = (each.noise_ratio for each in returns)
    assert expected > 0.0 and found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize('size', [*SIZES, 3, 1081])
def test_ring_band_filter(both, rng, size):
    """With and without a limit of gross errors; with every second beam missing; without the test."""
    for gross, noise in (0.05, 0.01), (0.0, 0.03), (0.5, 0.0):
        points = scan_points(rng, size)
        both(ring_band_filter, points, noise, dataclasses.replace(P.filter, gross_error=gross))
        points[::2] = np.nan
        both(ring_band_filter, points, noise, dataclasses.replace(P.filter, gross_error=gross))
    for test in ('consensus', 'off'):
        both(ring_band_filter, points, 0.01, dataclasses.replace(P.filter, test=test))


@pytest.mark.parametrize('size', [*SIZES, 3, 1081])
@pytest.mark.parametrize('increment', [1.0, -1.0])
def test_surfaces_and_segments(both, rng, size, increment):
    points, beams = returns(rng, size)
    noise = rng.uniform(0.0, 0.05, len(points))
    sequence = both(point_sequence, points, beams, increment * 2.0 * np.pi / max(size, 1), 0.01, P.segments)
    both(estimate_normals, sequence, noise, P.segments)
    if not len(points):
        return  # a scan without a return has no features
    for changes in ({}, {'max_segments': 3}, {'split_levels': 1}):
        both(extract_segments, sequence, noise, dataclasses.replace(P.segments, **changes))


def test_segments_of_equal_points(both):
    """Of no extent, and on a lattice, where many points are equally far from a chord."""
    for points in (np.ones(50, complex), np.repeat(np.arange(40.0), 2) + 1j * np.tile([1.0, 1.2], 40)):
        sequence = both(point_sequence, points, np.arange(len(points)), 0.02, 0.01, P.segments)
        both(estimate_normals, sequence, np.full(len(points), 0.01), P.segments)
        both(extract_segments, sequence, np.full(len(points), 0.01), P.segments)


@pytest.mark.parametrize('size', [*SIZES, 300, 70_000])
def test_likelihood_field(both, rng, size):
    points = oriented_points(rng, size)
    both(build_likelihood_field, points, P.density)
    both(build_likelihood_field, dataclasses.replace(points, points=np.round(points.points, 1)), P.density)
    both(build_likelihood_field, dataclasses.replace(points, points=1e3 * points.points), P.density)


@pytest.mark.parametrize('size', SIZES)
def test_leverage(both, rng, size):
    points = oriented_points(rng, size)
    for weights in (points.weights, None, np.zeros(size)):
        both(leverage, dataclasses.replace(points, weights=weights), 1.0)


def scans(rng, size):
    """A scan of the full circle, one of part of it, and one clockwise; with thin poles in front."""
    distance, bearings = ranges(rng, size)
    if size:
        distance[rng.integers(0, size, 1 + size // 40)] = 1.0
    for angles in (bearings, 0.5 * bearings, -bearings):
        yield Scan.from_ranges(distance, angles)


@pytest.mark.parametrize('size', [2, 7, 30, 360, 1081])
def test_features(both, rng, size):
    """From scans: also of too few returns, with the noise of far ranges, and the small objects among them."""
    for scan in scans(rng, size):
        for p in (P, dataclasses.replace(P, scan=dataclasses.replace(P.scan, min_returns=3, range_max=4.0))):
            try:
                returns = admitted_returns(scan, p.scan)
                features = both(extract_from_returns, returns, p, rng.choice([0.0, 0.04]))
            except ScanError as error:
                with pytest.raises(ScanError, match=re.escape(str(error))):
                    extract_features(scan, p, backend=both.compiled)
                continue
            both(extract_from_returns, returns, p)
            both(build_oriented_points, features.points, features.normals, features.beams)
            for width in (0.1, 1.0, 100.0):
                both(find_small_objects, features, width, p.segments)
                assert_same(*(step(features, width, p.segments).poles
                              for step in (with_poles, both.compiled.step(with_poles))))
            bare = dataclasses.replace(features, normals=np.zeros_like(features.normals))
            both(find_small_objects, bare, 0.5, p.segments)
            both(build_oriented_points, bare.points, bare.normals, bare.beams)
