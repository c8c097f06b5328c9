# SPDX-License-Identifier: Apache-2.0
"""Scans: bearings, points, which beams have a return, and scans made from points."""
import math
from types import SimpleNamespace

import numpy as np
import pytest
from rooms import DEGREE, FULL, L_ROOM, look, outline

from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.models.beam_timing import BeamTiming
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry


def test_polar_to_cartesian():
    """Eq. 1-2, either direction of rotation."""
    for increment in (0.25, -0.25):
        scan = Scan(0, [1.0, 2.0, 3.0], ScanGeometry(0.5, increment, 3))
        theta = 0.5 + increment * np.arange(3)
        np.testing.assert_allclose(scan.geometry.bearings, theta)
        np.testing.assert_allclose(scan.points[:, 0], [1.0, 2.0, 3.0] * np.cos(theta))
        np.testing.assert_allclose(scan.points[:, 1], [1.0, 2.0, 3.0] * np.sin(theta))


def test_angles_and_ranges_are_those_of_a_laser_scan_message():
    """float32: what is read from a log is what a message would have brought."""
    geometry = ScanGeometry(-1.1, DEGREE, 2, 0.1, 30.1)
    assert geometry.angle_min == float(np.float32(-1.1)) != -1.1
    assert geometry.range_max == float(np.float32(30.1))
    scan = Scan(0, [0.1, 30.1], geometry)
    assert scan.ranges.dtype == np.float32
    np.testing.assert_array_equal(scan.valid, [True, False])  # a range at the limit is no return


@pytest.mark.parametrize('value', [math.inf, -math.inf, math.nan, 0.0, -1.0, 81.83, 0.05, 1e39])
def test_beams_without_a_return(value):
    scan = Scan(0, [1.0, value, 2.0], ScanGeometry(0.0, 0.1, 3, 0.1, 50.0))
    np.testing.assert_array_equal(scan.valid, [True, False, True])
    np.testing.assert_array_equal(np.isfinite(scan.points).all(axis=1), [True, False, True])


@pytest.mark.parametrize('limit', [0.0, -1.0, math.inf, math.nan])
def test_a_maximum_that_says_nothing_is_no_limit(limit):
    scan = Scan(0, [1.0, 500.0, math.inf], ScanGeometry(0.0, 0.1, 3, math.nan, limit))
    np.testing.assert_array_equal(scan.valid, [True, True, False])


@pytest.mark.parametrize('arguments, words', [
    ((math.nan, 0.1, 5), 'finite'), ((0.0, math.inf, 5), 'finite'), ((0.0, 0.0, 5), 'angle_increment is 0'),
    ((0.0, 0.1, 0), '0 beams'), ((0.0, 0.1, 1_000_000), '1000000 beams'), ((0.0, 0.1, 1000), 'more than twice'),
    ((0.0, 0.1, 3, 0.0, 1.0, (0.0, 0.1)), '2 bearings for 3 beams'),
])
def test_impossible_geometries_are_named(arguments, words):
    with pytest.raises(ScanError, match=words):
        ScanGeometry(*arguments)


def test_as_many_ranges_as_beams():
    with pytest.raises(ScanError, match='4 ranges for 3 beams'):
        Scan(0, np.ones(4), ScanGeometry(0.0, 0.1, 3))
    with pytest.raises(ScanError, match=r'ranges of shape \(3, 1\)'):
        Scan(0, np.ones((3, 1)), ScanGeometry(0.0, 0.1, 3))


def test_a_scan_cannot_be_changed_nor_by_the_array_it_was_made_from():
    ranges = np.ones(3, dtype=np.float32)
    scan = Scan(0, ranges, ScanGeometry(0.0, 0.1, 3))
    ranges[0] = 5.0
    assert scan.ranges[0] == 1.0
    for array in (scan.ranges, scan.points, scan.valid, scan.geometry.bearings, scan.geometry.directions):
        with pytest.raises(ValueError, match='read-only'):
            array[0] = 0
    with pytest.raises(AttributeError):
        scan.stamp = 1


def message(**changes):
    stamp = SimpleNamespace(sec=12, nanosec=345)
    values = {'header': SimpleNamespace(stamp=stamp, frame_id='laser'), 'angle_min': -0.2, 'angle_increment': 0.1,
              'range_min': 0.1, 'range_max': 10.0, 'time_increment': 0.001, 'ranges': [1.0, 2.0, 3.0]}
    return SimpleNamespace(**(values | changes))


def test_a_message_keeps_its_stamp_and_frame():
    scan = Scan.from_message(message())
    assert (scan.stamp, scan.frame_id, len(scan.ranges)) == (12_000_000_345, 'laser', 3)
    assert scan.time_increment == float(np.float32(0.001))


def test_a_sensor_upside_down_sees_left_and_right_exchanged():
    up, down = Scan.from_message(message()), Scan.from_message(message(), upside_down=True)
    np.testing.assert_allclose(down.points, up.points * (1.0, -1.0))


def test_impossible_stamps_are_named():
    whole = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=0), frame_id='')
    assert Scan.from_message(message(header=whole)).stamp == 1_000_000_000
    for nanoseconds in (-1, 1_000_000_000, 2_000_000_000):
        header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=nanoseconds), frame_id='')
        with pytest.raises(ScanError, match=f'nanosec = {nanoseconds}:'):
            Scan.from_message(message(header=header))


def test_moved_points_become_a_scan_with_one_bearing_for_each():
    """The points of Figure 4: in beam order, to float32."""
    scan = look(outline(L_ROOM))
    motion = SE2(-1.5, 0.8, 0.3)
    moved = Scan.from_points(motion.apply(scan.points), angle_increment=DEGREE)
    assert moved.geometry.size == scan.geometry.size
    assert moved.geometry.angle_increment == scan.geometry.angle_increment
    np.testing.assert_allclose(moved.points, motion.apply(scan.points), atol=2e-6)


def test_points_that_are_missing_stay_missing_and_keep_their_beams():
    points = np.array([(np.nan, np.nan), (2.0, 1.0), (np.nan, np.nan), (1.0, 2.0)])
    scan = Scan.from_points(points)
    np.testing.assert_array_equal(scan.valid, [False, True, False, True])
    assert scan.geometry.bearings[1] < scan.geometry.bearings[2] < scan.geometry.bearings[3]
    with pytest.raises(ScanError, match='no finite point'):
        Scan.from_points(points[:1])


@pytest.mark.parametrize('bearings', [[], [[0.0, 1.0]], [0.0, math.nan]])
def test_bearings_are_one_finite_number_for_each_beam(bearings):
    with pytest.raises(ScanError, match='one finite number'):
        ScanGeometry.from_bearings(bearings)


def test_the_increment_of_given_bearings_is_the_usual_step_or_the_sensors_own():
    assert ScanGeometry.from_bearings([0.0, 0.1, 0.2, 0.9]).angle_increment == pytest.approx(0.1)
    assert ScanGeometry.from_bearings([0.0, 0.1], angle_increment=-0.2).angle_increment == pytest.approx(-0.2)
    assert ScanGeometry.from_bearings([1.0, 1.0]).angle_increment != 0.0
    assert ScanGeometry.from_bearings([1.0]).size == 1


def test_a_scan_with_too_few_returns_is_refused():
    ranges = np.full(360, np.inf)
    ranges[:7] = 2.0
    with pytest.raises(ScanError, match=r'7 of 360 beams have a return; advanced\.scan\.min_returns asks for 8'):
        extract_features(Scan(0, ranges, FULL))
    limited = Parameters().replace({'scan.range_max': 1.5})
    with pytest.raises(ScanError, match='0 of 360'):
        extract_features(Scan(0, np.full(360, 2.0), FULL), limited)


@pytest.mark.parametrize(('size', 'increment', 'closed'), [
    (360, math.radians(1.0), True), (360, 2.0 * math.pi / 359, True), (720, -math.radians(0.5), True),
    (350, math.radians(1.0), False), (181, math.radians(1.0), False), (1081, math.radians(0.25), False)])
def test_beams_that_go_all_the_way_round_are_closed(size, increment, closed):
    assert ScanGeometry(-math.pi, increment, size).closed == closed


@pytest.mark.parametrize('direction', ['as_sent', 'clockwise'])
def test_the_stamp_may_be_that_of_the_last_beam(direction):
    scan = Scan(7, np.arange(1.0, 6.0), ScanGeometry(0.3, 0.1, 5, 0.1, 8.0), 0.0, 'laser')
    first, last = (BeamTiming(direction, 0.2).of(scan, last_beam) for last_beam in (False, True))
    step = 0.2 * 0.1 / (2.0 * math.pi)
    assert (first.time_increment, last.time_increment) == pytest.approx((step, -step))
    np.testing.assert_allclose(first.points, last.points[::-1], atol=1e-6)


@pytest.mark.parametrize('increment, direction, flipped', [
    (0.1, 'as_sent', False), (0.1, 'counterclockwise', False), (0.1, 'clockwise', True), (-0.1, 'as_sent', False),
    (-0.1, 'clockwise', False), (-0.1, 'counterclockwise', True)])
def test_beams_are_put_in_the_order_of_their_measurement(increment, direction, flipped):
    geometry = ScanGeometry(0.3, increment, 5, 0.1, 8.0)
    scan = Scan(7, [1.0, 2.0, math.inf, 4.0, 5.0], geometry, 0.01, 'laser')
    measured = scan.as_measured(direction)
    if not flipped:
        assert measured is scan
        return
    assert (measured.stamp, measured.time_increment, measured.frame_id) == (7, scan.time_increment, 'laser')
    assert measured.geometry.angle_increment == -geometry.angle_increment
    np.testing.assert_allclose(measured.points, scan.points[::-1], atol=1e-6)
    uneven = ScanGeometry.from_bearings([0.0, 0.1, 0.25], math.copysign(0.1, increment))
    assert uneven.backwards.bearings.tolist() == uneven.bearings[::-1].tolist()
