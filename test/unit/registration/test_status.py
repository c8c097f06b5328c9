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
from dbscan_reg_ros.core.registration.hypotheses import Ranking
from dbscan_reg_ros.core.registration.point_to_line import fit
from dbscan_reg_ros.core.registration.records import Prior, Registration, Status
from dbscan_reg_ros.core.registration.scoring import find_rivals
from dbscan_reg_ros.core.registration.search import Problem
from dbscan_reg_ros.core.registration.status import decide, demoted_if_weak, rival_covariance
from dbscan_reg_ros.core.registration.uncertainty import uncertainty

ROOM = outline(L_ROOM)


def fitted(reference, current, motion):
    return fit(motion[None], current.sampled_points, reference.likelihood_field, Parameters().density.min_normal_cosine)


def test_rivals_widen_the_covariance_by_their_distance_in_the_sensor_frame():
    """By half of its square where the log-odds are equal."""
    candidates = np.array([(1.0, 2.0, 0.5 * math.pi), (1.0, 5.0, 2.5 * math.pi), (1.0, 2.1, 0.5 * math.pi)])
    rivals = find_rivals(candidates, None, Parameters().decision)
    assert rivals.tolist() == [False, True, False]
    assert rival_covariance(candidates, np.zeros(3), rivals) == pytest.approx(np.diag([4.5, 0.0, 0.0]), abs=1e-9)
    assert not rival_covariance(candidates, np.zeros(3), np.zeros(3, dtype=bool)).any()
    assert np.abs(rival_covariance(candidates, np.array([9.0, -9.0, 9.0]), rivals)).max() < 1e-6


def ranking(candidates, odds, best):
    size = len(odds)
    return Ranking(candidates, np.full(size, 0.9), np.ones(size), np.array(odds), best)


def test_a_rival_along_a_constrained_direction_makes_ambiguous():
    reference, current = extract_features(look(ROOM)), extract_features(look(ROOM, SE2(0.1, 0.0, 0.2)))
    best, parameters = np.array([0.1, 0.0, 0.2]), Parameters()
    found = fitted(reference, current, best)
    _, held = uncertainty(best, found, current.sampled_points, current.noise, parameters)
    assert held.weak > parameters.decision.min_information
    fine = best + np.array([(0.0, 0.0, 0.0), (math.cos(held.angle), math.sin(held.angle), 0.0)])
    alone = decide(Problem(reference, current, parameters), ranking(fine[:1], [0.0], found))
    odds = alone.hypotheses[0].log_odds
    for rival, status, variance in ((odds - 20.0, Status.OK, 0.0), (odds, Status.AMBIGUOUS, 0.5)):
        result = decide(Problem(reference, current, parameters), ranking(fine, [0.0, rival], found))
        assert result.status is status
        assert [each.log_odds for each in result.rivals] == [rival]
        assert result.margin == pytest.approx(odds - rival)
        assert np.trace(result.covariance) == pytest.approx(variance, abs=1e-3)


def test_along_a_degenerate_direction_there_is_no_rival():
    candidates = np.array([(0.0, 0.0, 0.0), (3.0 * math.cos(0.4), 3.0 * math.sin(0.4), 0.0)])
    for direction, different in ((None, True), (0.4, False), (0.4 + 0.5 * math.pi, True)):
        assert find_rivals(candidates, direction, Parameters().decision).tolist() == [False, different]


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
            assert found.reason == ('the translation along one direction is constrained by 9.90 points, expected at '
                                    'least 10.0, '
                                    'as the predicted translation has a standard deviation of 0.60 m')
