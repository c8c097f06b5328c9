# SPDX-License-Identifier: Apache-2.0
"""Line segments: breakpoints (Eq. 5), corners (Eq. 6), line fits (Eq. 7), ends."""
import math

import numpy as np
import pytest
from compiled_inputs import ranges
from rooms import DEGREE, HALF, L_ROOM, look, outline

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.features.records import EndKind
from dbscan_reg_ros.core.features.surfaces import find_breaks
from dbscan_reg_ros.core.geometry.se2 import SE2, as_complex, wrap
from dbscan_reg_ros.core.parameters.features import SegmentParameters
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry

PLAIN = Parameters().replace({'advanced.filter.test': 'off'})
NOISE = 0.005


def segments_of(walls, parameters=PLAIN, pose=SE2(), **changes):
    return extract_features(look(walls, pose, **changes), parameters).segments


def breaks_of(scan, parameters=SegmentParameters()):
    """Beams after which a break lies."""
    beams = np.flatnonzero(scan.valid)
    points = as_complex(scan.points[beams])
    return beams[:-1][find_breaks(points, beams, scan.geometry.angle_increment, NOISE, parameters)]


# Breakpoints


def panels():
    """Eleven panels 2 m away, square to the beam, each 6 deg wide, before a wall that goes round 4 m away.

    Returns the walls (S, 2, 2) and the 22 beams of a half circle after which the surface changes.
    """
    around = math.radians(5.0) * np.arange(73)
    far = 4.0 * np.stack((np.cos(around), np.sin(around)), axis=1)
    walls, breaks = [np.stack((far[:-1], far[1:]), axis=1)], []
    for i in range(11):
        first, last = 8 + 15 * i, 14 + 15 * i
        bearings = np.radians([first - 90.5, last - 89.5])
        walls.append(2.0 * np.stack((np.cos(bearings), np.sin(bearings)), axis=1)[None])
        breaks += [first - 1, last]
    return np.concatenate(walls), breaks


@pytest.mark.parametrize('changes', [{}, {'breakpoint_noise': 0.0, 'max_gap': 1}], ids=['defaults', 'paper'])
@pytest.mark.parametrize('noise', [0.0, 0.01])
def test_all_22_breakpoints_of_a_frame_and_no_other(changes, noise):
    """As Figure 3."""
    walls, expected = panels()
    found = breaks_of(look(walls, geometry=HALF, noise=noise), SegmentParameters(**changes))
    assert len(expected) == 22
    np.testing.assert_array_equal(found, expected)


def test_a_distance_equal_to_the_threshold_is_a_break():
    """D = 8 * 1 m * 1/8 rad = 1 m."""
    exact = SegmentParameters(breakpoint_noise=0.0)
    for distance, broken in ((1.0, True), (1.0 - 1e-9, False)):
        points = np.array([1.0, 1.0 + distance], dtype=complex)
        found = find_breaks(points, np.array([0, 1]), 0.125, NOISE, exact)
        np.testing.assert_array_equal(found, [broken])


@pytest.mark.parametrize('noise', [0.0, 0.005])
def test_corners_lie_where_the_walls_meet(noise):
    found = segments_of(outline(L_ROOM), PLAIN, noise=noise)
    at_corners = found.end[found.kinds[:, 1] == EndKind.CORNER]
    assert len(at_corners) >= 4
    nearest = np.linalg.norm(at_corners[:, None] - L_ROOM, axis=2).min(axis=1)
    assert nearest.max() < 0.01 + 5.0 * noise


@pytest.mark.parametrize('degrees, corners', [(14.0, 0), (22.0, 1)])
def test_walls_meet_in_a_corner_where_the_sine_of_their_angle_is_above_03(degrees, corners):
    far = 2.0 * np.array((1.0 - math.sin(math.radians(degrees)), math.cos(math.radians(degrees))))
    found = segments_of(np.array([[(2.0, -2.0), (2.0, 0.0)], [(2.0, 0.0), far]]), geometry=HALF)
    assert len(found) == 2 and np.count_nonzero(found.kinds[:, 1] == EndKind.CORNER) == corners


def test_a_corner_lies_before_the_middle_of_the_wall_that_begins_there():
    """In noise with clutter and outliers, where a wall may begin far from where the one before ends."""
    found = 0
    for seed in range(10):
        scan = Scan(0, ranges(np.random.default_rng(seed), 180)[0], ScanGeometry(-math.pi, 2.0 * DEGREE, 180))
        segments = extract_features(scan, PLAIN).segments
        for k in np.flatnonzero(segments.kinds[:, 1] == EndKind.CORNER):
            along = np.array((math.cos(segments.direction[k + 1]), math.sin(segments.direction[k + 1])))
            first, last = (scan.points[segments.beams[k + 1]] - segments.end[k]) @ along
            assert abs(first) < 0.5 * (last - first)
            found += 1
    assert found > 10


# Line fits


@pytest.mark.parametrize('turn', (0, 60, 210))
def test_every_wall_of_a_room_is_found_wherever_the_sensor_looks(turn):
    """A point at a corner may count for the wrong wall: 1 cm and a degree, for walls of some length."""
    pose = SE2(0.3, 0.2, math.radians(turn))
    found = segments_of(outline(L_ROOM), PLAIN, pose)
    walls = outline(L_ROOM)
    direction = np.arctan2(*(walls[:, 1] - walls[:, 0]).T[::-1])
    normal = np.stack((-np.sin(direction), np.cos(direction)), axis=1)
    turned = np.abs(wrap(found.direction[:, None] + pose.theta - direction))
    off = np.abs(((pose.apply(found.midpoint)[:, None] - walls[:, 0]) * normal).sum(axis=2))
    on = (turned < math.radians(1.0)) & (off < 0.01)
    assert on.any(axis=0).all(), 'a wall was not found'
    assert on.any(axis=1)[found.length > 0.5].all(), 'a segment lies on no wall'


def test_a_clockwise_lidar_sees_the_mirrored_room():
    """Walls run counter-clockwise whichever way the beams go."""
    mirrored = outline(L_ROOM * (1.0, -1.0))
    clockwise = ScanGeometry(math.pi, -DEGREE, 360)
    found, other = segments_of(outline(L_ROOM)), segments_of(mirrored, geometry=clockwise)
    np.testing.assert_allclose(other.start, found.end * (1.0, -1.0), atol=1e-5)
    np.testing.assert_allclose(other.end, found.start * (1.0, -1.0), atol=1e-5)
    np.testing.assert_allclose(wrap(other.direction + found.direction - math.pi), 0.0, atol=1e-5)
    np.testing.assert_array_equal(other.kinds, found.kinds[:, ::-1])
    np.testing.assert_array_equal(other.beams, found.beams[:, ::-1])


def test_errors_of_the_fit_agree_with_its_covariance():
    """A wall 2 m ahead, 100 times with noise: errors in units of their standard deviations."""
    wall = np.array([[(2.0, -2.0), (2.0, 2.0)]])
    direction, offset = [], []
    for seed in range(100):
        found = segments_of(wall, PLAIN, geometry=HALF, noise=0.01, seed=seed)
        assert len(found) == 1
        direction.append(wrap(found.direction[0] - 0.5 * math.pi) / found.sigma_direction[0])
        offset.append((found.midpoint[0, 0] - 2.0) / found.sigma_offset[0])
    assert 0.5 < np.std(direction) < 1.3
    assert 0.5 < np.std(offset) < 1.5
    assert abs(np.mean(direction)) < 0.4


def test_short_walls_and_few_points_are_no_segment():
    wall = np.array([[(2.0, -0.1), (2.0, 0.1)]])
    scan = look(np.concatenate((wall, outline([(-9.0, -9.0), (9.0, -9.0), (9.0, 9.0), (-9.0, 9.0)]))))
    near = {'advanced.segments.min_length': 0.1, 'advanced.segments.min_points': 4}

    def near_segments(**changes):
        found = extract_features(scan, PLAIN.replace(near | changes)).segments
        return np.count_nonzero(np.hypot(*found.midpoint.T) < 3.0)

    assert near_segments() == 1
    assert near_segments(**{'advanced.segments.min_length': 0.3}) == 0
    assert near_segments(**{'advanced.segments.min_points': 7}) == 0


# Ends


def test_ends_before_a_background_are_free_and_hidden_ends_are_not():
    """A panel before a wall: the panel ends in the open, the wall's ends beside it move with the sensor."""
    walls = np.array([[(2.0, -0.5), (2.0, 0.5)], [(4.0, -3.0), (4.0, 3.0)]])
    found = segments_of(walls, geometry=HALF)
    assert len(found) == 3
    np.testing.assert_array_equal(found.kinds[1], [EndKind.FREE, EndKind.FREE])
    assert found.kinds[0, 1] == found.kinds[2, 0] == EndKind.OCCLUSION
    np.testing.assert_allclose(found.midpoint[1], (2.0, 0.0), atol=2.0 * 2.0 * DEGREE)


@pytest.mark.parametrize('depth, kind', [(0.16, EndKind.OCCLUSION), (0.2, EndKind.FREE)])
def test_a_wall_ends_where_what_is_behind_lies_deeper_than_the_margin_and_the_noise(depth, kind):
    """A margin of 0.15 m and three times a noise of 0.01 m."""
    walls = np.array([[(2.0, -0.5), (2.0, 0.5)], [(2.0 + depth, -5.0), (2.0 + depth, 5.0)]])
    parameters = PLAIN.replace({'scan.noise_min': 0.01, 'scan.noise_max': 0.01,
                                'advanced.segments.breakpoint_noise': 0.0, 'advanced.segments.breakpoint_factor': 2.0})
    found = segments_of(walls, parameters, geometry=HALF)
    front = np.flatnonzero(np.abs(found.midpoint[:, 0] - 2.0) < 0.01)
    assert found.kinds[front].tolist() == [[kind, kind]]


@pytest.mark.parametrize('missing, beams', [(26, [[0, 68]]), (28, [[0, 19], [48, 68]])])
def test_parts_of_one_wall_are_joined_across_a_gap_of_up_to_a_metre(missing, beams):
    """Without 26 beams the parts are 0.96 m apart, without 28 of them 1.03 m."""
    scan = look(np.array([[(2.0, -50.0), (2.0, 50.0)]]), geometry=ScanGeometry(-0.6, DEGREE, 69))
    ranges = np.array(scan.ranges)
    ranges[20:20 + missing] = np.inf
    found = extract_features(Scan(0, ranges, scan.geometry), PLAIN.replace({'advanced.segments.max_gap': 1})).segments
    assert found.beams.tolist() == beams
