# SPDX-License-Identifier: Apache-2.0
"""Status of a registration: alternative hypotheses, few points."""
import math

import numpy as np
import pytest
from rooms import L_ROOM, look, outline

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.parameters.registration import DecisionParameters
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.confidence.assessment import assess
from dbscan_reg_ros.core.registration.point_to_line import Hypotheses
from dbscan_reg_ros.core.registration.problem import Problem
from dbscan_reg_ros.core.registration.records import Hypothesis, Prior, Registration, Status
from dbscan_reg_ros.core.registration.scoring import find_rivals
from dbscan_reg_ros.core.registration.status import decide, demoted_if_weak, rival_covariance

ROOM = outline(L_ROOM)


def test_rivals_widen_the_covariance_by_their_distance_in_the_sensor_frame():
    """By half of its square where the log-odds are equal."""
    candidates = np.array([(1.0, 2.0, 0.5 * math.pi), (1.0, 5.0, 2.5 * math.pi), (1.0, 2.1, 0.5 * math.pi)])
    assert find_rivals(candidates, None).tolist() == [False, True, False]
    best, rival, unlikely = (Hypothesis(SE2.from_array(candidates[k]), 0.9, odds)
                             for k, odds in ((0, 9.0), (1, 9.0), (1, -9.0)))
    assert rival_covariance(best, [rival]) == pytest.approx(np.diag([4.5, 0.0, 0.0]), abs=1e-9)
    assert np.abs(rival_covariance(best, [unlikely])).max() < 1e-6


def test_a_rival_along_a_constrained_direction_makes_ambiguous():
    reference, current = extract_features(look(ROOM)), extract_features(look(ROOM, SE2(0.1, 0.0, 0.2)))
    problem = Problem(reference, current, Parameters())
    alone = assess(problem, Hypotheses(np.array([(0.1, 0.0, 0.2)])))
    (best,), held = alone.hypotheses, alone.observed
    assert held.weak > problem.parameters.decision.min_information and not alone.rivals
    away = best.transform.as_array() + np.array((math.cos(held.angle), math.sin(held.angle), 0.0))
    for odds, status, variance in ((best.log_odds - 20.0, Status.OK, 0.0), (best.log_odds, Status.AMBIGUOUS, 0.5)):
        rival = Hypothesis(SE2.from_array(away), 0.9, odds)
        result = decide(problem, alone._replace(hypotheses=(best, rival), rivals=(rival,)))
        assert result.status is status
        assert result.margin == pytest.approx(best.log_odds - odds)
        assert np.trace(result.covariance) == pytest.approx(variance, abs=1e-3)


def test_hypotheses_that_are_different_motions_are_assessed_best_first():
    reference, current = extract_features(look(ROOM)), extract_features(look(ROOM, SE2(0.1, 0.0, 0.2)))
    problem = Problem(reference, current, Parameters())
    found = assess(problem, Hypotheses(np.array([(0.9, 0.3, 0.2), (0.1, 0.01, 0.2), (0.1, 0.0, 0.2)])))
    best, rival = found.hypotheses
    assert found.rivals == (rival,) and best.log_odds > rival.log_odds + 1.0
    assert (best.transform.inverse() @ SE2(0.1, 0.0, 0.2)).as_array() == pytest.approx([0.0, 0.0, 0.0], abs=3e-3)
    assert rival.transform.as_array() == pytest.approx([0.9, 0.3, 0.2])


@pytest.mark.parametrize(('status', 'weakest', 'spread', 'expected'), [
    (Status.OK, 9.9, 0.6, Status.DEGENERATE), (Status.OK, 10.0, 0.6, Status.OK), (Status.OK, 9.9, 0.5, Status.OK),
    (Status.OK, None, 0.6, Status.OK), (Status.AMBIGUOUS, 9.9, 0.6, Status.AMBIGUOUS),
])
def test_few_points_are_degenerate_with_a_weak_prior(status, weakest, spread, expected):
    registration = Registration(SE2(), np.eye(3), status, weakest_information=weakest)
    for covariance in (np.diag([spread, 0.1, 0.1]) ** 2, np.diag([0.1, spread, 0.1]) ** 2):
        found = demoted_if_weak(registration, Prior(SE2(), covariance),
                                DecisionParameters(weak_prior_information=10.0))
        assert found.status is expected
        if expected is not status:
            assert found.reason == ('the translation along one direction is constrained by 9.90 points, expected at '
                                    'least 10.0, '
                                    'as the predicted translation has a standard deviation of 0.60 m')
