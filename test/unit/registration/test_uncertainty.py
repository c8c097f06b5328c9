# SPDX-License-Identifier: Apache-2.0
"""Observability and covariance of a registration."""
import math

import numpy as np
import pytest
from l_room import jacobian, normal_equations, table

from dbscan_reg_ros.core.parameters.registration import DecisionParameters
from dbscan_reg_ros.core.registration.uncertainty import degenerate_rotation, degenerate_translation, match_covariance

ALONE = {'covariance_scale': 1.0, 'parallel_tolerance': 0.0}
PARAMETERS = DecisionParameters(few_points_scale=0.0, **ALONE)
VARIANCE = 1e-4


def turned(matrix, angle):
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turn @ matrix @ turn.T


def judged(information, shared, points=100.0, parameters=PARAMETERS):
    """As of three points of that information, of which both scans share a part."""
    values, vectors = np.linalg.eigh(information)
    rows = vectors * np.sqrt(np.maximum(values, 0.0))
    weight = points / 3.0
    own = (np.linalg.pinv(rows, rcond=1e-9) @ shared).T
    residuals = table(rows / math.sqrt(weight), np.full(3, weight), own / math.sqrt(weight))
    return match_covariance(residuals, math.sqrt(VARIANCE), parameters, 0.0)


def test_a_direction_that_hardly_a_point_constrains_is_degenerate():
    information = turned(np.diag([0.5, 150.0, 400.0]), 0.7)
    covariance, held = judged(information, information)
    along = np.array([math.cos(0.7), math.sin(0.7), 0.0])
    assert held.weak == pytest.approx(0.5)
    assert math.sin(held.angle - 0.7) == pytest.approx(0.0, abs=1e-9)
    assert along @ covariance @ along > 100.0
    across = np.array([-math.sin(0.7), math.cos(0.7), 0.0])
    assert across @ covariance @ across == pytest.approx(VARIANCE / 150.0, rel=1e-3)


def test_observability_is_that_of_the_shared_information():
    information, along = np.diag([4.0, 150.0, 400.0]), np.array([1.0, 0.0, 0.0])
    for shared, weak in ((4.0, 4.0), (0.9, 0.9), (-0.5, 0.0)):
        covariance, held = judged(information, np.diag([shared, 150.0, 400.0]))
        assert held.weak == pytest.approx(weak) and math.sin(held.angle) == pytest.approx(0.0, abs=1e-9)
        assert (along @ covariance @ along > 90.0) == (weak < PARAMETERS.min_information)


def test_a_rotation_that_only_noise_constrains_is_unobservable():
    information = np.diag([80.0, 80.0, 400.0])
    for shared, points, free in ((300.0, 100.0, False), (300.0, 1.0, True), (100.0, 100.0, True),
                                 (100.0, 1000.0, False)):
        covariance, held = judged(information, np.diag([80.0, 80.0, shared]), points)
        assert (held.rotation < PARAMETERS.min_information) == free
        assert (covariance[2, 2] > 9.0) == free
        assert covariance[0, 0] == pytest.approx(VARIANCE / 80.0, rel=1e-3)


def test_a_translation_degenerate_only_with_a_rotation_makes_both_uncertain():
    """In a circular room, 3 m from its centre."""
    held_across, held_while_straight = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 3.0])
    information = 80.0 * (np.outer(held_across, held_across) + np.outer(held_while_straight, held_while_straight))
    covariance, held = judged(information, information)
    assert held.weak == pytest.approx(0.0, abs=1e-6)
    assert math.cos(held.angle) == pytest.approx(0.0, abs=1e-3)
    assert math.sqrt(covariance[1, 1]) > 10.0
    assert math.sqrt(covariance[1, 1] / covariance[2, 2]) == pytest.approx(3.0, rel=0.05)
    assert held_while_straight @ covariance @ held_while_straight < 0.01 * covariance[1, 1]


def test_in_a_circular_room_the_degenerate_translation_and_rotation_are_coupled():
    """By all points of its wall, seen 2 m from its middle, which lies on the left."""
    around = np.exp(2j * np.pi / 360 * np.arange(360))
    rotated_points = 2j + 3.0 * around
    rows = jacobian((-around).conj(), rotated_points)
    information = normal_equations(rows, np.ones(360))
    along, turn = degenerate_translation(0.0, information, PARAMETERS), degenerate_rotation(information, information,
                                                                                            PARAMETERS)
    assert along == pytest.approx([1.0, 0.0, 0.5], rel=1e-6, abs=1e-9)
    assert turn == pytest.approx([2.0, 0.0, 1.0], rel=0.02, abs=1e-9)
    assert turn @ information @ turn < 1e-3 * information[2, 2]
    assert degenerate_translation(0.5 * math.pi, information, PARAMETERS) == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)


def test_few_points_add_to_the_variance():
    information = np.diag([8.0, 800.0, 400.0])
    plain, _ = judged(information, information)
    careful, _ = judged(information, information, parameters=DecisionParameters(few_points_scale=8.0, **ALONE))
    assert careful - plain == pytest.approx(np.diag([VARIANCE / 8.0, 0.0, 0.0]), abs=1e-12)
