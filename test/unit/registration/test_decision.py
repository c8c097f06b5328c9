# SPDX-License-Identifier: Apache-2.0
"""Status and covariance of a registration."""
import math

import numpy as np
import pytest
from rooms import L_ROOM, look, outline

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.parameters.registration import DecisionParameters
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.point_to_line import fit, jacobian, normal_equations
from dbscan_reg_ros.core.registration.records import Prior, Registration, Status
from dbscan_reg_ros.core.registration.search import Problem, Ranking
from dbscan_reg_ros.core.registration.status import decide, demoted_if_weak, scatter, slid
from dbscan_reg_ros.core.registration.uncertainty import (
    calibrated_covariance,
    degenerate_rotation,
    degenerate_translation,
    observability,
    uncertainty,
)

ROOM = outline(L_ROOM)
PARAMETERS = DecisionParameters(few_points_scale=0.0, covariance_scale=1.0)
VARIANCE = 1e-4


def fitted(reference, current, motion):
    return fit(motion[None], current.sampled_points, reference.likelihood_field, Parameters().density.min_normal_cosine)


def turned(matrix, angle):
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turn @ matrix @ turn.T


def judged(information, shared, points=100.0, parameters=PARAMETERS):
    held = observability(information, shared, points, parameters)
    return calibrated_covariance(information, shared, VARIANCE, held, parameters), held


def test_the_covariance_is_the_inverse_of_the_information():
    information = np.diag([100.0, 50.0, 400.0])
    covariance, held = judged(information, information)
    assert (held.weak, held.rotation) == pytest.approx((50.0, 400.0))
    assert np.diag(covariance) == pytest.approx([1e-6, 2e-6, 2.5e-7], rel=1e-3)


def test_a_direction_that_hardly_a_point_holds_is_free():
    information = turned(np.diag([0.5, 150.0, 400.0]), 0.7)
    covariance, held = judged(information, information)
    along = np.array([math.cos(0.7), math.sin(0.7), 0.0])
    assert held.weak == pytest.approx(0.5)
    assert math.sin(held.angle - 0.7) == pytest.approx(0.0, abs=1e-9)
    assert along @ covariance @ along > 100.0
    across = np.array([-math.sin(0.7), math.cos(0.7), 0.0])
    assert across @ covariance @ across == pytest.approx(VARIANCE / 150.0, rel=1e-3)


def test_a_direction_is_held_by_what_both_scans_agree_on():
    information, along = np.diag([4.0, 150.0, 400.0]), np.array([1.0, 0.0, 0.0])
    for shared, weak in ((4.0, 4.0), (0.9, 0.9), (-0.5, 0.0)):
        covariance, held = judged(information, np.diag([shared, 150.0, 400.0]))
        assert held.weak == pytest.approx(weak) and math.sin(held.angle) == pytest.approx(0.0, abs=1e-9)
        assert (along @ covariance @ along > 90.0) == (weak < PARAMETERS.min_information)


def test_a_rotation_that_only_noise_holds_is_free():
    information = np.diag([80.0, 80.0, 400.0])
    for shared, points, free in ((300.0, 100.0, False), (300.0, 1.0, True), (100.0, 100.0, True), (100.0, 1000.0, False)):
        covariance, held = judged(information, np.diag([80.0, 80.0, shared]), points)
        assert (held.rotation < PARAMETERS.min_information) == free
        assert (covariance[2, 2] > 9.0) == free
        assert covariance[0, 0] == pytest.approx(VARIANCE / 80.0, rel=1e-3)


def test_where_a_way_is_free_with_a_turn_only_both_are_uncertain_together():
    """Around a round room, 3 m from its middle."""
    held_across, held_while_straight = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 3.0])
    information = 80.0 * (np.outer(held_across, held_across) + np.outer(held_while_straight, held_while_straight))
    covariance, held = judged(information, information)
    assert held.weak == pytest.approx(0.0, abs=1e-6)
    assert math.cos(held.angle) == pytest.approx(0.0, abs=1e-3)
    assert math.sqrt(covariance[1, 1]) > 10.0
    assert math.sqrt(covariance[1, 1] / covariance[2, 2]) == pytest.approx(3.0, rel=0.05)
    assert held_while_straight @ covariance @ held_while_straight < 0.01 * covariance[1, 1]


def test_around_a_round_room_a_way_turns_and_a_turn_is_a_way():
    """By all points of its wall, seen 2 m from its middle, which lies on the left."""
    around = np.exp(2j * np.pi / 360 * np.arange(360))
    rotated_points = 2j + 3.0 * around
    rows = jacobian((-around).conj(), rotated_points)
    information = normal_equations(rows, np.ones(360))
    along, turn = degenerate_translation(0.0, information, PARAMETERS), degenerate_rotation(information, information, PARAMETERS)
    assert along == pytest.approx([1.0, 0.0, 0.5], rel=1e-6, abs=1e-9)
    assert turn == pytest.approx([2.0, 0.0, 1.0], rel=0.02, abs=1e-9)
    assert turn @ information @ turn < 1e-3 * information[2, 2]
    assert degenerate_translation(0.5 * math.pi, information, PARAMETERS) == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)


def test_as_many_points_as_few_double_the_variance():
    information = np.diag([8.0, 800.0, 400.0])
    plain, _ = judged(information, information)
    careful, _ = judged(information, information, parameters=DecisionParameters(few_points_scale=8.0, covariance_scale=1.0))
    assert careful - plain == pytest.approx(np.diag([VARIANCE / 8.0, 0.0, 0.0]), abs=1e-12)


def test_rivals_widen_the_covariance_by_their_distance_in_the_sensors_frame():
    best = np.array([1.0, 2.0, 0.5 * math.pi])
    found = scatter(best, np.array([[1.0, 5.0, 0.5 * math.pi + 2.0 * math.pi]]))
    assert found == pytest.approx(np.diag([4.5, 0.0, 0.0]), abs=1e-9)
    assert not scatter(best, np.empty((0, 3))).any()


def test_hypotheses_slid_along_a_direction_are_level_with_the_best():
    best = np.array([1.0, 1.0, 0.2])
    away = best + [3.0 * math.cos(0.4), 3.0 * math.sin(0.4), 0.0] + np.array([-math.sin(0.4), math.cos(0.4), 0.0])
    level, = slid(away[None], best, 0.4)
    assert level == pytest.approx(best + [-math.sin(0.4), math.cos(0.4), 0.0])


def ranking(candidates, score, best):
    return Ranking(candidates, np.array(score), np.ones(len(score)), np.zeros((len(score), 4, 4)), best)


def test_a_rival_along_a_direction_that_is_held_is_a_rival():
    reference, current = extract_features(look(ROOM)), extract_features(look(ROOM, SE2(0.1, 0.0, 0.2)))
    best, parameters = np.array([0.1, 0.0, 0.2]), Parameters()
    found = fitted(reference, current, best)
    _, held = uncertainty(best, found, current.sampled_points, current.noise, parameters)
    assert held.weak > parameters.decision.min_information
    coarse = np.array([best, best + [math.cos(held.angle), math.sin(held.angle), 0.0]])
    for rival, status, variance in ((0.6, Status.OK, 0.0), (0.88, Status.AMBIGUOUS, 0.5)):
        result = decide(Problem(reference, current, parameters), ranking(best[None], [0.9], found), ranking(coarse, [0.9, rival], found))
        assert result.status is status
        assert np.trace(result.covariance) == pytest.approx(variance, abs=1e-3)


def test_a_rival_is_compared_with_the_best_as_both_were_after_the_coarse_refinement():
    """A fine score is less by what of the reference lies in the current scan's free space."""
    reference, current = extract_features(look(ROOM)), extract_features(look(ROOM, SE2(0.1, 0.0, 0.2)))
    best = np.array([0.1, 0.0, 0.2])
    coarse = np.array([best, best + [1.0, 1.0, 1.0]])
    for rival, status in ((0.8, Status.OK), (0.88, Status.AMBIGUOUS)):
        found = fitted(reference, current, best)
        result = decide(Problem(reference, current, Parameters()), ranking(best[None], [0.7], found), ranking(coarse, [0.9, rival], found))
        assert result.status is status


@pytest.mark.parametrize(('status', 'weakest', 'spread', 'expected'), [
    (Status.OK, 9.9, 0.6, Status.DEGENERATE), (Status.OK, 10.0, 0.6, Status.OK), (Status.OK, 9.9, 0.5, Status.OK),
    (Status.OK, None, 0.6, Status.OK), (Status.AMBIGUOUS, 9.9, 0.6, Status.AMBIGUOUS),
])
def test_few_points_are_not_enough_where_nothing_is_known_of_the_motion(status, weakest, spread, expected):
    registration = Registration(SE2(), np.eye(3), status, weakest_information=weakest)
    for covariance in (np.diag([spread, 0.1, 0.1]) ** 2, np.diag([0.1, spread, 0.1]) ** 2):
        found = demoted_if_weak(registration, Prior(SE2(), covariance), DecisionParameters(weak_prior_sigma=0.5, weak_prior_information=10.0))
        assert found.status is expected
        if expected is not status:
            assert found.reason == ('the translation along one direction is constrained by 9.90 points; expected at least 10.0, '
                                    'as the predicted translation has a standard deviation of 0.60 m')
