# SPDX-License-Identifier: Apache-2.0
"""Ring band filter: the panels of Figure 1, the regions of Figure 2, and what the paper does not specify."""
import math

import numpy as np
import pytest
from rooms import corner, pushed, seen, wall

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.ring_band import Outcome, ring_band_filter
from dbscan_reg_ros.core.parameters.features import RingBandParameters
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.scan import Scan

NOISE = 0.004
KEPT, SMOOTHED, REMOVED = Outcome.KEPT, Outcome.SMOOTHED, Outcome.REMOVED
P4, P5, P6 = 9, 10, 11
"""The beams of Figure 1 within 21 beams, P5 in the middle."""


def filtered(points, **changes):
    return ring_band_filter(points, NOISE, RingBandParameters(**({'gross_error': 0.0} | changes)))


def only(beam, outcome, size=21):
    expected = np.zeros(size, dtype=int)
    expected[beam] = outcome
    return expected


@pytest.mark.parametrize('error', [0.12, -0.12])
def test_figure_1a_noise_on_a_wall_becomes_the_mean_of_the_inner_ring(error):
    points = pushed(wall(), {10: error})
    after, outcome = filtered(points)
    np.testing.assert_array_equal(outcome, only(P5, SMOOTHED))
    np.testing.assert_allclose(after[P5], points[P4:P6 + 1].mean(axis=0))
    assert after[P5, 0] - 2.0 == pytest.approx(error / 3.0, rel=0.01)
    np.testing.assert_array_equal(np.delete(after, P5, axis=0), np.delete(points, P5, axis=0))


@pytest.mark.parametrize('vertex', [9.75, 10.0, 10.25])
def test_figure_1b_a_corner_keeps_its_place(vertex):
    points = corner(vertex)
    after, outcome = filtered(points)
    assert not outcome.any()
    np.testing.assert_array_equal(after, points)


def test_figure_1c_noise_next_to_a_corner_is_removed():
    """The second wall begins just before P6, which would draw the mean off the first wall."""
    points = pushed(corner(9.9), {10: 0.15})
    after, outcome = filtered(points)
    np.testing.assert_array_equal(outcome, only(P5, REMOVED))
    assert np.isnan(after[P5]).all()
    np.testing.assert_array_equal(np.delete(after, P5, axis=0), np.delete(points, P5, axis=0))


ROOM = (((1.0, 0.0), 3.0), ((0.0, 1.0), 2.5), ((-1.0, 0.0), 1.918), ((0.0, -1.0), 2.0))
BEARINGS = np.arange(-180, 180) * math.radians(1.0)
REGION_1, REGION_2 = 178, 265
"""Noise on the walls x = 3 m and y = 2.5 m."""
REGION_4 = 308
"""Noise beside the corner at (-1.918, 2.5) m."""


@pytest.fixture
def room():
    points = seen(BEARINGS, *ROOM)
    return points, pushed(points, {178: 0.15, 265: -0.15, 308: 0.25})


def corner_beams(points):
    """The beam nearest to each of the room's corners, except that of region 4."""
    corners = np.array([(3.0, -2.0), (3.0, 2.5), (-1.918, -2.0)])
    return np.argmin(np.linalg.norm(points[:, None] - corners, axis=2), axis=0)


def test_figure_2_noise_on_walls_is_smoothed_and_removed_beside_a_corner_and_corners_stay(room):
    clean, noisy = room
    after, outcome = filtered(noisy)
    np.testing.assert_array_equal(np.flatnonzero(outcome), [REGION_1, REGION_2, REGION_4])
    assert outcome[REGION_1] == outcome[REGION_2] == SMOOTHED and outcome[REGION_4] == REMOVED
    assert np.isnan(after[REGION_4]).all()
    for region in (REGION_1, REGION_2):
        np.testing.assert_allclose(after[region], noisy[region - 1:region + 2].mean(axis=0))
        before = np.linalg.norm(noisy[region] - clean[region])
        assert np.linalg.norm(after[region] - clean[region]) < 0.4 * before
    corners = corner_beams(clean)
    np.testing.assert_array_equal(after[corners], noisy[corners])


def test_a_gross_outlier_is_removed_and_not_smeared_over_three_beams():
    points = pushed(wall(), {10: 1.0})
    after, outcome = filtered(points, gross_error=0.05)
    np.testing.assert_array_equal(outcome, only(P5, REMOVED))
    assert np.isfinite(np.delete(after, P5, axis=0)).all()
    assert filtered(points, gross_error=0.0)[1][P5] == SMOOTHED


def test_consensus_judges_the_beams_at_both_ends():
    """The first and the last beam have no inner ring to average: they stay."""
    for beam in range(21):
        outcome = filtered(pushed(wall(), {beam: 0.3}))[1]
        np.testing.assert_array_equal(outcome, only(beam, KEPT if beam in (0, 20) else SMOOTHED))
        gross = filtered(pushed(wall(), {beam: 0.3}), gross_error=0.05)[1]
        np.testing.assert_array_equal(gross, only(beam, REMOVED))


@pytest.mark.parametrize('missing', [(9,), (11,), (7, 13), (8, 12), (6,)])
def test_missing_returns_are_passed_over(missing):
    points = wall()
    points[list(missing)] = np.nan
    after, outcome = filtered(points)
    assert not outcome.any()
    np.testing.assert_array_equal(after, points)
    after, outcome = filtered(pushed(points, {10: 1.0}), gross_error=0.05)
    np.testing.assert_array_equal(outcome, only(P5, REMOVED))


@pytest.mark.parametrize('spacing', [2, 3, 5, 8])
def test_where_most_beams_have_no_return_the_ring_is_made_of_returns(spacing):
    """The ring of beams holds too few of them to make a line."""
    points = np.full((21 * spacing, 2), np.nan)
    points[::spacing] = pushed(wall(), {10: 0.3})
    np.testing.assert_array_equal(filtered(points, gross_error=0.05)[1], only(P5 * spacing, REMOVED, len(points)))


def test_both_sides_of_a_range_jump_are_kept():
    near, far = wall(), 2.5 * wall()
    for edge in range(3, 18):
        points = np.where((np.arange(21) < edge)[:, None], near, far)
        assert not filtered(points, gross_error=0.05)[1].any()


def test_the_features_of_a_scan_are_made_from_its_filtered_points():
    points = pushed(seen(BEARINGS, *ROOM), {178: 1.0})
    scan = Scan.from_points(points, angle_increment=math.radians(1.0))
    assert REGION_1 in extract_features(scan, Parameters().replace({'advanced.filter.test': 'off'})).beams
    assert REGION_1 not in extract_features(scan).beams
