# SPDX-License-Identifier: Apache-2.0
"""Small isolated objects without normals become round poles, which constrain the odometry among chairs and trees."""
import math

import numpy as np
import pytest
from rooms import FULL, L_ROOM, outline

from dbscan_reg_ros import SE2, Parameters
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.poles import with_poles
from dbscan_reg_ros.core.registration.point_to_line import refine
from dbscan_reg_ros.core.registration.residuals import Alignment
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.simulation.raycasting import cast

UNFILTERED = Parameters().replace({'advanced.filter.test': 'off'})
SEGMENTS = UNFILTERED.segments
LEG, OTHER = (1.2, 0.6, 0.02), (0.4, 1.3, 0.025)
WALLS = outline(L_ROOM)[[0, 5]]
"""Two walls of a room; there is no wall behind the legs."""


def place_with(*circles, pose=SE2(), geometry=FULL):
    """Features of what a lidar at `pose` measures of two walls and of round things [m]."""
    directions = np.exp(1j * (geometry.bearings + pose.theta))
    ranges = cast(np.array([[pose.x, pose.y]]), np.column_stack((directions.real, directions.imag)), WALLS,
                  np.array(circles).reshape(-1, 3))
    return extract_features(Scan(0, ranges, geometry), UNFILTERED)


def middles(features):
    """Centres of the poles, complex [m]."""
    return features.poles.points.reshape(-1, 8).mean(axis=1)


def test_a_leg_is_points_all_around_it():
    features = with_poles(place_with(LEG), 0.3, SEGMENTS)
    poles = features.poles.points.reshape(-1, 8)
    beams = np.flatnonzero(np.abs(features.scan.ranges - math.hypot(*LEG[:2])) < 0.05)
    assert len(poles) == 1 and set(features.poles.beams) == {beams[0]}
    middle, = middles(features)
    assert abs(middle - complex(*LEG[:2])) < 0.01
    half = 0.5 * len(beams) * math.radians(1.0) * abs(middle)
    assert np.abs(poles - middle) == pytest.approx(half, rel=0.02)
    away = features.poles.points - middle
    assert (features.poles.normals * away.conj()).real == pytest.approx(np.abs(away))
    assert features.poles.weights.sum() == pytest.approx(2.0 * len(beams))


def test_it_does_not_matter_at_which_beam_the_scan_begins():
    """Twelve legs all around, one of them on both sides of the seam now and then."""
    legs = [(1.2 * math.cos(a), 1.2 * math.sin(a), 0.025) for a in np.radians(np.arange(0.5, 360.0, 30.0))]
    for first in range(-180, 180, 5):
        geometry = ScanGeometry(math.radians(first), math.radians(1.0), 360)
        features = with_poles(place_with(*legs, geometry=geometry), 0.3, SEGMENTS)
        assert len(features.poles) == 8 * len(legs)
        assert features.poles.beams.min() >= 0 and features.poles.beams.max() < 360


def test_poles_can_be_left_out_and_downweighted():
    features = with_poles(place_with(LEG, OTHER), 0.3, SEGMENTS)
    cloud, walls = features.oriented_points, len(features.wall_points)
    assert len(cloud) == walls + 16 and (cloud.weights[:walls] == 1.0).all()
    assert np.array_equal(cloud.weights[walls:], features.poles.weights)
    left_out = np.zeros(len(cloud), dtype=bool)
    left_out[[3, 4, *range(walls, walls + 8)]] = True
    less = features.without(left_out)
    assert np.array_equal(less.oriented_points.points, cloud.points[~left_out]) and len(less.poles) == 8
    assert np.array_equal(less.oriented_points.weights, cloud.weights[~left_out])
    downweighted = features.downweighted(np.arange(walls, walls + 16), 0.1).oriented_points
    assert downweighted.weights[walls:] == pytest.approx(0.1 * features.poles.weights)
    assert (downweighted.weights[:walls] == 1.0).all()


@pytest.mark.parametrize('circle', [(0.6, -1.42, 0.03), (1.2, 0.6, 0.3)], ids=['before a wall', 'large'])
def test_a_large_object_or_one_close_to_a_wall_is_no_pole(circle):
    features = place_with(circle)
    assert with_poles(features, 0.3, SEGMENTS) is features


def test_an_object_is_isolated_unless_a_nearer_one_is_beside_it():
    """Two returns with none around them; then with one of something nearer beside them."""
    ranges = np.full(360, np.inf)
    ranges[100:180] = 2.0 / np.cos(np.radians(np.arange(100, 180) - 140.0))
    ranges[200:202] = 1.5
    alone = with_poles(extract_features(Scan(0, ranges, FULL), UNFILTERED), 0.3, SEGMENTS)
    assert abs(middles(alone)[0]) == pytest.approx(1.5 + 1.5 * math.radians(1.0), abs=0.01) and len(alone.poles) == 8
    ranges[202] = 0.9
    beside = with_poles(extract_features(Scan(0, ranges, FULL), UNFILTERED), 0.3, SEGMENTS)
    assert beside.poles is None or np.abs(middles(beside)).max() < 1.0


@pytest.mark.parametrize('closed', [True, False])
def test_an_object_at_the_end_of_a_scan_is_not_isolated(closed):
    """The first beam hits a leg; its neighbour before it is known in a full circle only."""
    geometry = FULL if closed else ScanGeometry(-math.pi, math.radians(1.0), 330)
    assert geometry.closed == closed
    features = with_poles(place_with((-1.2, 0.0, 0.012), geometry=geometry), 0.3, SEGMENTS)
    assert (features.poles is not None) == closed


def test_a_pole_constrains_both_directions():
    """Two legs without walls, seen from a pose 5 cm and 0.02 rad away."""
    def seen(pose):
        legs = place_with(LEG, OTHER, pose=pose)
        features = with_poles(legs, 0.3, SEGMENTS)
        return features.without(np.arange(len(features.oriented_points)) < len(features.wall_points))
    pose = SE2(0.04, -0.03, 0.02)
    reference, current = seen(SE2()), seen(pose)
    assert len(reference.oriented_points) == len(current.oriented_points) == 16
    found, _ = refine(np.zeros((1, 3)), Alignment(current.sampled_points, reference.likelihood_field, 0.003),
                      [0.2] * 10)
    assert found[0] == pytest.approx(pose.as_array(), abs=0.012)
