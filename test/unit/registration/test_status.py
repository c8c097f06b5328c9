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
from dbscan_reg_ros.core.registration.point_to_line import fit
from dbscan_reg_ros.core.registration.records import Prior, Registration, Status
from dbscan_reg_ros.core.registration.search import Problem, Ranking
from dbscan_reg_ros.core.registration.status import decide, demoted_if_weak, scatter, slid
from dbscan_reg_ros.core.registration.uncertainty import uncertainty

ROOM = outline(L_ROOM)


def fitted(reference, current, motion):
    return fit(motion[None], current.sampled_points, reference.likelihood_field, Parameters().density.min_normal_cosine)


def test_alternatives_widen_the_covariance_by_their_distance_in_the_sensor_frame():
    best = np.array([1.0, 2.0, 0.5 * math.pi])
    found = scatter(best, np.array([[1.0, 5.0, 0.5 * math.pi + 2.0 * math.pi]]))
    assert found == pytest.approx(np.diag([4.5, 0.0, 0.0]), abs=1e-9)
    assert not scatter(best, np.empty((0, 3))).any()


def test_hypotheses_are_slid_along_a_direction_to_the_best():
    best = np.array([1.0, 1.0, 0.2])
    along, across = np.array([math.cos(0.4), math.sin(0.4), 0.0]), np.array([-math.sin(0.4), math.cos(0.4), 0.0])
    away = best + 3.0 * along + across
    level, = slid(away[None], best, 0.4)
    assert level == pytest.approx(best + across)


def ranking(candidates, score, best):
    return Ranking(candidates, np.array(score), np.ones(len(score)), np.zeros((len(score), 4, 4)), best)


def test_an_alternative_along_a_constrained_direction_makes_ambiguous():
    reference, current = extract_features(look(ROOM)), extract_features(look(ROOM, SE2(0.1, 0.0, 0.2)))
    best, parameters = np.array([0.1, 0.0, 0.2]), Parameters()
    found = fitted(reference, current, best)
    _, held = uncertainty(best, found, current.sampled_points, current.noise, parameters)
    assert held.weak > parameters.decision.min_information
    coarse = best + np.array([(0.0, 0.0, 0.0), (math.cos(held.angle), math.sin(held.angle), 0.0)])
    for rival, status, variance in ((0.6, Status.OK, 0.0), (0.88, Status.AMBIGUOUS, 0.5)):
        result = decide(Problem(reference, current, parameters), ranking(best[None], [0.9], found),
                        ranking(coarse, [0.9, rival], found))
        assert result.status is status
        assert np.trace(result.covariance) == pytest.approx(variance, abs=1e-3)


def test_alternatives_are_compared_by_their_scores_after_the_coarse_refinement():
    """A fine score is less by what of the reference lies in the current scan's free space."""
    reference, current = extract_features(look(ROOM)), extract_features(look(ROOM, SE2(0.1, 0.0, 0.2)))
    best = np.array([0.1, 0.0, 0.2])
    coarse = best + np.array([(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)])
    for rival, status in ((0.8, Status.OK), (0.88, Status.AMBIGUOUS)):
        found = fitted(reference, current, best)
        result = decide(Problem(reference, current, Parameters()), ranking(best[None], [0.7], found),
                        ranking(coarse, [0.9, rival], found))
        assert result.status is status


@pytest.mark.parametrize(('status', 'weakest', 'spread', 'expected'), [
    (Status.OK, 9.9, 0.6, Status.DEGENERATE), (Status.OK, 10.0, 0.6, Status.OK), (Status.OK, 9.9, 0.5, Status.OK),
    (Status.OK, None, 0.6, Status.OK), (Status.AMBIGUOUS, 9.9, 0.6, Status.AMBIGUOUS),
])
def test_few_points_are_degenerate_with_a_weak_prior(status, weakest, spread, expected):
    registration = Registration(SE2(), np.eye(3), status, weakest_information=weakest)
    for covariance in (np.diag([spread, 0.1, 0.1]) ** 2, np.diag([0.1, spread, 0.1]) ** 2):
        found = demoted_if_weak(registration, Prior(SE2(), covariance),
                                DecisionParameters(weak_prior_sigma=0.5, weak_prior_information=10.0))
        assert found.status is expected
        if expected is not status:
            assert found.reason == ('the translation along one direction is constrained by 9.90 points; expected at '
                                    'least 10.0, '
                                    'as the predicted translation has a standard deviation of 0.60 m')
