"""Status and covariance of a registration."""
import math

import numpy as np
import pytest
from rooms import L_ROOM, look, outline

from dbscan_reg_ros.core.decision import calibrated, decide, doubted, scatter, slid, uncertainty
from dbscan_reg_ros.core.features import extract_features
from dbscan_reg_ros.core.parameters import DecisionParameters, Parameters
from dbscan_reg_ros.core.records import Prior, Registration, Status
from dbscan_reg_ros.core.se2 import SE2

ROOM = outline(L_ROOM)
PARAMETERS = DecisionParameters(few=0.0, covariance_scale=1.0)
VARIANCE = 1e-4


def turned(matrix, angle):
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return turn @ matrix @ turn.T


def test_the_covariance_is_the_inverse_of_the_information():
    information = np.diag([100.0, 50.0, 400.0])
    covariance, _, weak = calibrated(information, information, VARIANCE, PARAMETERS)
    assert weak == pytest.approx(50.0)
    assert np.diag(covariance) == pytest.approx([1e-6, 2e-6, 2.5e-7], rel=1e-3)


def test_a_direction_that_hardly_a_point_holds_is_free():
    information = turned(np.diag([0.5, 150.0, 400.0]), 0.7)
    covariance, angle, weak = calibrated(information, information, VARIANCE, PARAMETERS)
    along = np.array([math.cos(0.7), math.sin(0.7), 0.0])
    assert weak == pytest.approx(0.5)
    assert math.sin(angle - 0.7) == pytest.approx(0.0, abs=1e-9)
    assert along @ covariance @ along > 100.0
    across = np.array([-math.sin(0.7), math.cos(0.7), 0.0])
    assert across @ covariance @ across == pytest.approx(VARIANCE / 150.0, rel=1e-3)


def test_a_direction_is_held_by_what_both_scans_agree_on():
    information, along = np.diag([4.0, 150.0, 400.0]), np.array([1.0, 0.0, 0.0])
    for shared, held in ((4.0, 4.0), (0.9, 0.9), (-0.5, 0.0)):
        covariance, angle, weak = calibrated(information, np.diag([shared, 150.0, 400.0]), VARIANCE, PARAMETERS)
        assert weak == pytest.approx(held) and math.sin(angle) == pytest.approx(0.0, abs=1e-9)
        assert (along @ covariance @ along > 90.0) == (held < PARAMETERS.min_information)


def test_as_many_points_as_few_double_the_variance():
    information = np.diag([8.0, 800.0, 400.0])
    plain = calibrated(information, information, VARIANCE, PARAMETERS)[0]
    careful = calibrated(information, information, VARIANCE, DecisionParameters(few=8.0, covariance_scale=1.0))[0]
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


def test_a_rival_along_a_direction_that_is_held_is_a_rival():
    reference, current = extract_features(look(ROOM)), extract_features(look(ROOM, SE2(0.1, 0.0, 0.2)))
    best, parameters = np.array([0.1, 0.0, 0.2]), Parameters()
    _, angle, weak = uncertainty(best, reference, current, parameters)
    assert weak > parameters.decision.min_information
    coarse = np.array([best, best + [math.cos(angle), math.sin(angle), 0.0]])
    for rival, status, variance in ((0.6, Status.OK, 0.0), (0.88, Status.AMBIGUOUS, 0.5)):
        found = decide(best[None], np.array([0.9]), np.array([1.0]), coarse, np.array([0.9, rival]), reference, current, parameters)
        assert found.status is status
        assert np.trace(found.covariance) == pytest.approx(variance, abs=1e-3)


@pytest.mark.parametrize(('status', 'weakest', 'spread', 'expected'), [
    (Status.OK, 9.9, 0.6, Status.DEGENERATE), (Status.OK, 10.0, 0.6, Status.OK), (Status.OK, 9.9, 0.5, Status.OK),
    (Status.OK, None, 0.6, Status.OK), (Status.AMBIGUOUS, 9.9, 0.6, Status.AMBIGUOUS),
])
def test_few_points_are_not_enough_where_nothing_is_known_of_the_motion(status, weakest, spread, expected):
    registration = Registration(SE2(), np.eye(3), status, weakest=weakest)
    for covariance in (np.diag([spread, 0.1, 0.1]) ** 2, np.diag([0.1, spread, 0.1]) ** 2):
        found = doubted(registration, Prior(SE2(), covariance), DecisionParameters(vague=0.5, vague_information=10.0))
        assert found.status is expected
        if expected is not status:
            assert found.reason == ('only 9.90 points hold the motion along one direction; 10.0 asked for where the motion '
                                    'is expected to 0.60 m only')
