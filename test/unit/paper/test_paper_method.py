# SPDX-License-Identifier: Apache-2.0
"""The method of the paper from the lines on: rotation (Eq. 9), translation (Eq. 10-15), and a whole registration."""
import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from rooms import FOUR_WALLS, HALF, look, moved, outline, segments_between

from dbscan_reg_ros.core.geometry.se2 import SE2, wrap
from dbscan_reg_ros.core.paper import translation
from dbscan_reg_ros.core.paper.pipeline import _scatter, register
from dbscan_reg_ros.core.paper.rotation import estimate_rotation
from dbscan_reg_ros.core.paper.translation import estimate_translations, line_equations, squared_solutions
from dbscan_reg_ros.core.registration.records import Status

MOTION = SE2(0.4, -0.3, 0.2)


walls = partial(segments_between, kind=0, sigma=np.nan)
"""Segments without what the paper does not know: the kinds of their ends, and standard deviations."""


def lines(directions):
    """Segments of 1 m in the given directions [rad]."""
    return walls(*[((0.0, 0.0), (math.cos(angle), math.sin(angle))) for angle in directions])


ROOM = walls(*FOUR_WALLS)


@pytest.mark.parametrize('degrees', [-80, -40, 0, 17, 40, 80])
def test_lines_without_a_direction_give_a_rotation_up_to_180_degrees(degrees):
    """Walls of 0, 50 and 110 deg: no other rotation aligns three walls."""
    directions = np.radians([0.0, 50.0, 110.0])
    for turn in (0.0, math.pi):
        found = estimate_rotation(lines(directions), lines(directions - math.radians(degrees) + turn))
        assert wrap(found.phi - math.radians(degrees)) == pytest.approx(0.0, abs=1e-9)


def test_the_cluster_is_that_of_the_most_samples_also_across_the_seam():
    """The paper's 0.08 in the plane of (d, d) is 0.0566 in angle: the gap that separates clusters."""
    found = estimate_rotation(lines([0.30, 0.31, 0.32, -0.5]), lines([0.0]))
    assert found.phi[0] == pytest.approx(0.31) and found.weight[0] == 3.0
    assert found.labels[:, 0].tolist() == [0, 0, 0, -1]
    for gap, count in ((0.056, 3.0), (0.058, 1.0)):
        assert estimate_rotation(lines([0.0, gap, 2.0 * gap]), lines([0.0])).weight[0] == count
    half = 0.5 * math.pi
    seam = estimate_rotation(lines([half - 0.02, half - 0.01, half, -half + 0.01, -half + 0.02]), lines([0.0]))
    assert seam.weight[0] == 5.0 and math.remainder(seam.phi[0] - half, math.pi) == pytest.approx(0.0, abs=1e-9)


def test_without_lines_there_is_neither_rotation_nor_translation():
    for reference, current in ((walls(), ROOM), (ROOM, walls()), (walls(), walls())):
        found = estimate_rotation(reference, current)
        assert len(found.phi) == 0 and found.labels.shape == (len(reference), len(current))
        assert estimate_translations(reference, current, found.phi).samples.shape == (0, 2)


def test_a_squared_equation_knows_the_distance_of_two_parallel_lines():
    """Eq. 14: the distance of the rotated midpoint from the other line, in the mean direction modulo pi."""
    angle, distance = line_equations(ROOM, moved(ROOM, MOTION), MOTION.theta)
    for i, theta in enumerate(ROOM.direction):
        asked = -math.sin(theta) * MOTION.x + math.cos(theta) * MOTION.y
        assert distance[i] == pytest.approx(abs(asked), abs=1e-9)
        assert math.remainder(angle[i] - theta, math.pi) == pytest.approx(0.0, abs=1e-9)
    for a, b in ((0.1, 0.16), (math.pi - 0.01, -math.pi + 0.03), (0.5 * math.pi - 0.01, -0.5 * math.pi + 0.03)):
        (middle,), _ = line_equations(lines([a]), lines([b]), 0.0)
        off = middle - a - 0.5 * math.remainder(b - a, math.pi)
        assert math.remainder(off, math.pi) == pytest.approx(0.0, abs=1e-9)


def test_eps1_shrinks_until_no_more_pairs_are_left_than_the_current_scan_has_segments(monkeypatch):
    """Four lines each of nearly one direction: 16 pairs pass 0.1 rad."""
    fan, one = lines([0.0, 0.011, 0.023, 0.036]), lines([0.0])
    np.testing.assert_allclose(line_equations(fan, fan, 0.0)[0], fan.direction, atol=1e-12)
    assert len(line_equations(fan, one, 0.0)[0]) == 1 and len(line_equations(one, fan, 0.0)[0]) == 4
    monkeypatch.setattr(translation, '_PARALLEL', 0.02)
    assert len(line_equations(one, fan, 0.0)[0]) == 2


def test_two_squared_equations_have_four_solutions():
    """Eq. 15: each satisfies both, two and two are opposite, one is the motion; lines that hardly cross give none."""
    pair = walls(((0.0, -2.0), (6.0, -2.0)), ((6.0, -2.0), (5.0, 1.0)))
    angle, distance = line_equations(pair, moved(pair, MOTION), MOTION.theta)
    samples = squared_solutions(angle, distance)
    normal = np.stack((-np.sin(angle), np.cos(angle)), axis=1)
    np.testing.assert_allclose((samples @ normal.T) ** 2, np.tile(distance ** 2, (4, 1)), atol=1e-12)
    np.testing.assert_allclose(samples, -samples[::-1], atol=1e-12)
    assert np.linalg.norm(samples - (MOTION.x, MOTION.y), axis=1).min() < 1e-9
    assert len(np.unique(samples.round(6), axis=0)) == 4
    for sine, count in ((0.36, 4), (0.34, 0)):
        assert len(squared_solutions(np.array([0.0, math.asin(sine)]), np.ones(2))) == count


def test_the_two_key_clusters_are_opposite_and_the_mixed_signs_scatter():
    """As regions 1 and 2 of Figure 8."""
    found = estimate_translations(ROOM, moved(ROOM, MOTION), np.array([MOTION.theta]))
    assert len(found.samples) == 4 * 6
    np.testing.assert_array_equal(found.weight[:2], [6.0, 6.0])
    assert found.weight[2:].max() < 6.0 and np.bincount(found.labels)[0] == 6
    np.testing.assert_allclose(found.transform[0, :2], -found.transform[1, :2], atol=1e-9)
    assert np.linalg.norm(found.transform[:2, :2] - (MOTION.x, MOTION.y), axis=1).min() < 1e-9


FIVE_WALLS = outline([(-2.0, -1.5), (3.0, -2.0), (4.5, 0.5), (2.5, 3.0), (-1.0, 2.5)])
"""A room whose walls all have directions of their own: no other pairs of walls are parallel."""
MOTIONS = [SE2(0.2, -0.15, 0.1), SE2(0.3, 0.2, 0.15), SE2(-0.25, 0.2, -0.2)]


@pytest.mark.parametrize('noise', [0.0, 0.005])
@pytest.mark.parametrize('motion', MOTIONS)
def test_a_room_is_registered_and_the_best_of_both_key_clusters_are_reported_best_first(motion, noise):
    found = register(*(look(FIVE_WALLS, pose, noise=noise, seed=i) for i, pose in enumerate((SE2(), motion))))
    error = motion.inverse() @ found.transform
    assert math.hypot(error.x, error.y) < 0.03 and abs(error.theta) < 0.005
    assert found.status is Status.OK and found.score > 0.95 and len(found.matches) >= 5
    right, opposite = found.hypotheses
    assert right.transform == found.transform and right.score == found.score > opposite.score
    assert opposite.transform.x == pytest.approx(-right.transform.x, abs=0.02)
    assert opposite.transform.y == pytest.approx(-right.transform.y, abs=0.02)
    np.testing.assert_allclose(found.covariance, found.covariance.T)
    assert np.linalg.eigvalsh(found.covariance).min() >= 1e-6 and found.covariance.max() < 0.01


def test_the_covariance_is_in_the_sensors_frame():
    """A result at (1, 2) that faces along y; its cluster spreads along y, ahead of it: 0.1 m once in two."""
    rotations = SimpleNamespace(difference=np.array([[0.5 * math.pi + 0.2, -0.5 * math.pi], [9.0, 9.0]]),
                                labels=np.array([[0, 0], [-1, -1]]))
    translations = SimpleNamespace(samples=np.array([(1.0, 2.0), (1.0, 2.1), (7.0, 7.0)]), labels=np.array([0, 0, 1]))
    found = _scatter(SE2(1.0, 2.0, 0.5 * math.pi), 0, rotations, translations)
    assert found == pytest.approx(np.diag([0.005, 0.0, 0.02]) + 1e-6 * np.eye(3))


def test_where_no_lines_cross_the_registration_fails_and_says_why():
    scan = look(np.array([[(2.0, -3.0), (2.0, 3.0)]]), geometry=HALF)
    found = register(scan, scan)
    assert found.status is Status.FAILED and 'no two pairs of lines cross' in found.reason
