# SPDX-License-Identifier: Apache-2.0
"""Properties of the registration and the odometry that follow from geometry, each with its tolerance."""
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros import SE2, Scan, ScanGeometry, Status, register
from dbscan_reg_ros.core.features.extraction import extract_features

ROOM = outline(L_ROOM)
NOISE = 0.01
"""Of a range [m]."""
METRES, RADIANS = 0.5 * NOISE, 0.002
"""How far two answers to the same question may be apart where the points fall into other cells of the grid."""

ANGLES = st.floats(-math.pi, math.pi)
STEPS = st.floats(-0.4, 0.4)
MOTIONS = st.builds(SE2, STEPS, STEPS, st.floats(-1.0, 1.0))
SEEDS = st.integers(0, 2**31 - 1)
START = SE2(0.2, 0.1, 0.3)


def pair(motion, seed, geometry=FULL):
    """Two scans with noise of their own, `motion` apart."""
    return [look(ROOM, pose, geometry, NOISE, seed + k) for k, pose in enumerate((START, START @ motion))]


def motion_of(reference, current):
    registration = register(extract_features(reference), extract_features(current))
    assert registration.status is Status.OK
    return registration.transform


def with_geometry(scan, **changes):
    g = scan.geometry
    values = {'angle_min': g.angle_min, 'angle_increment': g.angle_increment, 'size': g.size} | changes
    return Scan(scan.stamp, scan.ranges, ScanGeometry(values['angle_min'], values['angle_increment'], values['size'],
                                                      g.range_min, g.range_max))


def assert_same(one, two, metres=METRES, radians=RADIANS):
    apart = one.inverse() @ two
    assert math.hypot(apart.x, apart.y) <= metres
    assert abs(apart.theta) <= radians


@given(MOTIONS, ANGLES, SEEDS)
def test_bearings_that_begin_elsewhere_turn_the_translation_and_leave_the_rotation(motion, delta, seed):
    scans = pair(motion, seed)
    plain = motion_of(*scans)
    turned = motion_of(*(with_geometry(scan, angle_min=scan.geometry.angle_min + delta) for scan in scans))
    turn = SE2(0.0, 0.0, delta)
    assert_same(turn @ plain @ turn.inverse(), turned)


@given(MOTIONS, SEEDS)
def test_swapping_the_scans_inverts_the_motion(motion, seed):
    one, two = pair(motion, seed)
    assert_same(motion_of(one, two).inverse(), motion_of(two, one), NOISE, 0.004)


@given(MOTIONS, SEEDS)
def test_a_mirrored_clockwise_lidar_gives_the_mirrored_motion(motion, seed):
    scans = pair(motion, seed)
    plain = motion_of(*scans)
    mirrored = motion_of(*(with_geometry(scan, angle_min=-scan.geometry.angle_min,
                                         angle_increment=-scan.geometry.angle_increment) for scan in scans))
    assert_same(SE2(plain.x, -plain.y, -plain.theta), mirrored)


@given(MOTIONS, SEEDS, st.integers(1, 60), st.integers(1, 60))
def test_beams_without_a_return_at_the_ends_change_nothing(motion, seed, before, after):
    half = ScanGeometry(-0.75 * math.pi, FULL.angle_increment, 270)
    scans = pair(motion, seed, half)
    plain = motion_of(*scans)
    wider = []
    for scan in scans:
        ranges = np.concatenate((np.full(before, math.inf), scan.ranges, np.full(after, math.nan)))
        step = scan.geometry.angle_increment
        wider.append(Scan(0, ranges, ScanGeometry(scan.geometry.angle_min - before * step, step, len(ranges))))
    assert_same(plain, motion_of(*wider), 0.001, 0.0005)


@given(st.lists(MOTIONS, min_size=2, max_size=2), SEEDS)
def test_motions_around_a_loop_close(motions, seed):
    poses = [START, START @ motions[0], START @ motions[1]]
    scans = [look(ROOM, pose, FULL, NOISE, seed + k) for k, pose in enumerate(poses)]
    around = SE2()
    for k in range(3):
        around = around @ motion_of(scans[k], scans[(k + 1) % 3])
    assert_same(around, SE2(), 2.0 * NOISE, 0.008)


@given(MOTIONS, MOTIONS, SEEDS)
def test_a_registration_does_not_depend_on_what_was_registered_before(motion, other, seed):
    one, two = map(extract_features, pair(motion, seed))
    first = register(one, two)
    register(two, extract_features(pair(other, seed)[1]))
    fresh = register(*map(extract_features, pair(motion, seed)))
    for again in (register(one, two), fresh):
        assert again.transform == first.transform
        assert (again.covariance == first.covariance).all() and (again.status, again.score) == (first.status,
                                                                                                first.score)
