# SPDX-License-Identifier: Apache-2.0
"""The filter and the lines of the paper: Figures 1 and 2, Eq. 3-7."""
import itertools
import math

import numpy as np
import pytest
from rooms import DEGREE, L_ROOM, corner, look, outline, pushed, wall

from dbscan_reg_ros.core.features.ring_band import Outcome
from dbscan_reg_ros.core.geometry.se2 import SE2, as_complex
from dbscan_reg_ros.core.paper import lines
from dbscan_reg_ros.core.paper.lines import (
    Moments,
    cut_at_corners,
    find_breaks,
    fit_sections,
    rank_corners,
    slope_differences,
)
from dbscan_reg_ros.core.paper.pipeline import ScanLines
from dbscan_reg_ros.core.paper.ring_band import ring_band_filter
from dbscan_reg_ros.core.scan_geometry import ScanGeometry

NOISE = 0.005
SMOOTHED, REMOVED = Outcome.SMOOTHED, Outcome.REMOVED


@pytest.mark.parametrize('error', [0.12, -0.12])
def test_figure_1a_noise_on_a_wall_becomes_the_mean_of_the_inner_ring(error):
    """The first four and the last three beams have no full ring."""
    for beam in range(21):
        points = pushed(wall(), {beam: error})
        after, outcome = ring_band_filter(points)
        if not 4 <= beam < 18:
            assert not outcome[beam]
            continue
        np.testing.assert_array_equal(outcome.nonzero()[0], [beam])
        assert outcome[beam] == SMOOTHED
        np.testing.assert_allclose(after[beam], points[beam - 1:beam + 2].mean(axis=0))


@pytest.mark.parametrize('vertex', [9.75, 10.0, 10.25])
def test_figure_1b_a_corner_keeps_its_place(vertex):
    points = corner(vertex)
    after, outcome = ring_band_filter(points)
    assert not outcome.any()
    np.testing.assert_array_equal(after, points)


def test_figure_1c_noise_next_to_a_corner_is_removed():
    """The second wall begins just before the next beam, which would draw the mean off the first wall."""
    after, outcome = ring_band_filter(pushed(corner(9.9), {10: 0.15}))
    assert outcome[10] == REMOVED and np.isnan(after[10]).all() and np.count_nonzero(outcome) == 1


def test_a_ring_across_a_range_jump_is_not_judged_and_missing_returns_are_passed_over():
    for edge in range(3, 18):
        assert not ring_band_filter(np.where((np.arange(21) < edge)[:, None], wall(), 2.5 * wall()))[1].any()
    sparse = np.full((63, 2), np.nan)
    sparse[::3] = pushed(wall(), {10: 0.3})
    after, outcome = ring_band_filter(sparse)
    assert not outcome.any(), 'without a whole inner ring nothing is averaged'
    np.testing.assert_array_equal(after, sparse)
    for size in (0, 1, 7, 8):
        assert not ring_band_filter(np.full((size, 2), np.nan))[1].any()


def test_a_distance_equal_to_the_threshold_or_a_missing_beam_is_a_break():
    """D = 8 * 1 m * 1/8 rad = 1 m (Eq. 5)."""
    for distance, beam, broken in ((1.0, 1, True), (1.0 - 1e-9, 1, False), (0.1, 2, True)):
        found = find_breaks(np.array([1.0, 1.0 + distance], dtype=complex), np.array([0, beam]), -0.125)
        assert found.tolist() == [broken]


def test_the_slope_difference_is_that_of_the_paper_and_takes_three_points_of_one_surface():
    """Eq. 6, beam by beam."""
    scan, breaks = look(outline(L_ROOM), noise=0.01), np.zeros(359, dtype=bool)
    rho, step = scan.ranges.astype(float), scan.geometry.angle_increment
    found = slope_differences(as_complex(scan.points), breaks)
    for i in range(1, 359):
        expected = abs((rho[i] - rho[i - 1]) / (rho[i - 1] * step) - (rho[i + 1] - rho[i]) / (rho[i] * step))
        assert found[i] == pytest.approx(expected, rel=1e-6, abs=1e-6)
    breaks[100] = True
    found = slope_differences(as_complex(scan.points), breaks)
    np.testing.assert_array_equal(found[[0, 100, 101, 359]], 0.0)
    assert (np.delete(found, [0, 100, 101, 359]) > 0.0).all()


def test_only_local_maxima_are_corners_the_greatest_first():
    rank = rank_corners(np.array([9.0, 1.0, 3.0, 2.0, 2.0, 7.0, 0.0, 5.0]))
    np.testing.assert_array_equal(rank, [8, 8, 1, 8, 8, 0, 8, 8])


def section_means(points):
    """Means of five equal sections (Eq. 7); of fewer points each is a section."""
    edges = len(points) * np.arange(6) // 5
    return np.array([points[a:b].mean(axis=0) for a, b in itertools.pairwise(edges) if b > a])


def straight_error(points):
    """Sum of squared distances of the points from the line through the means of the sections, by SVD."""
    means = section_means(points)
    normal = np.linalg.svd(means - means.mean(axis=0))[2][-1] if len(means) > 1 else np.zeros(2)
    return (((points - means.mean(axis=0)) @ normal) ** 2).sum()


@pytest.mark.parametrize('seed, penalty', [(0, 1.0), (1, 30.0), (2, 30.0)])
def test_the_threshold_that_wins_is_the_best_of_all(monkeypatch, penalty, seed):
    """Every threshold in turn, as the paper describes it."""
    monkeypatch.setattr(lines, '_CORNER_PENALTY', penalty)
    scan = look(outline(L_ROOM), noise=0.01, geometry=ScanGeometry(-math.pi, 4.0 * DEGREE, 90), seed=seed)
    points, breaks = scan.points, np.zeros(89, dtype=bool)
    breaks[40] = True
    difference = slope_differences(as_complex(points), breaks)
    peaks = [i for i in range(1, 89) if difference[i] > max(difference[i - 1], difference[i + 1])]
    best = None
    for threshold in [math.inf, *sorted(difference[peaks] - 1e-12, reverse=True)]:
        corners = [i for i in peaks if difference[i] > threshold]
        first, last = sorted([0, 41, *corners]), sorted([40, 89, *corners])
        errors = [straight_error(points[a:b + 1]) for a, b in zip(first, last, strict=True)]
        cost = sum(errors) / NOISE ** 2 + penalty * len(errors)
        if best is None or cost < best[0] - 1e-9:
            best = cost, first, last
    first, last = cut_at_corners(as_complex(points), breaks, np.full(90, NOISE))
    np.testing.assert_array_equal(first, best[1])
    np.testing.assert_array_equal(last, best[2])


def test_lines_are_fitted_to_the_means_of_five_sections():
    rng = np.random.default_rng(0)
    points = rng.normal(0.0, 1.0, (40, 2)) * (2.0, 0.1) @ SE2(0.0, 0.0, 1.2).rotation().T + (3.0, -2.0)
    first, last = np.array([0, 3, 10, 20]), np.array([2, 9, 39, 39])
    found = fit_sections(Moments.of(as_complex(points)), first, last)
    for i, (a, b) in enumerate(zip(first, last, strict=True)):
        means, along = section_means(points[a:b + 1]), (math.cos(found.angle[i]), math.sin(found.angle[i]))
        assert found.centre[i] == pytest.approx(complex(*means.mean(axis=0)))
        assert abs(np.linalg.svd(means - means.mean(axis=0))[2][0] @ along) == pytest.approx(1.0)
        assert found.residual[i] == pytest.approx(straight_error(points[a:b + 1]) / (b - a + 1), rel=1e-6)


@pytest.mark.parametrize('noise', [0.0, 0.005])
def test_the_walls_of_a_room_are_found_and_their_corners_lie_where_they_meet(noise):
    found = ScanLines.of(look(outline(L_ROOM), noise=noise)).segments
    at_corners = found.end[found.kinds[:, 1] == 0]
    assert 6 <= len(found) <= 9 and len(at_corners) >= 4
    assert np.linalg.norm(at_corners[:, None] - L_ROOM, axis=2).min(axis=1).max() < 0.01 + 5.0 * noise
    np.testing.assert_allclose(found.length, np.hypot(*(found.end - found.start).T))
