# SPDX-License-Identifier: Apache-2.0
"""The gate: every decision with its reason, and what it takes of priors."""
import dataclasses
import math

import numpy as np
import pytest

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.gate import Gate
from dbscan_reg_ros.core.odometry.models.stamps import ScanInterval
from dbscan_reg_ros.core.odometry.models.wheel_calibration import WheelCalibration
from dbscan_reg_ros.core.odometry.prediction import Prediction, Predictions
from dbscan_reg_ros.core.odometry.state import Mode, Tracking
from dbscan_reg_ros.core.odometry.verdict import Decision, Reason, Verdict
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.records import Prior, Registration, Status

P = Parameters()
TICK = ScanInterval(0.1, 0.1, 0.0, steady=True)
SIGMA = np.diag((0.01, 0.01, 0.01)) ** 2
"""Covariance of a precise prior: the gate is 4 cm, 0.04 rad."""
WITHIN = Verdict(Decision.ACCEPT, Reason.WITHIN_GATE)
MANY, FEW = 10.0 * P.decision.weak_prior_information, 0.5 * P.decision.weak_prior_information


def result(status=Status.OK, information=MANY, direction=None):
    return Registration(SE2(), SIGMA, status, degenerate_direction=direction, weakest_information=information)


def predicted(x, covariance=SIGMA, change=SIGMA):
    """A prediction at `x` [m] from the last pose, the origin."""
    prior = Prior(SE2(x), covariance, change)
    return Prediction(prior.transform, prior, covariance)


def gate(best=0.0, motion=0.0, external=False, covariance=SIGMA, tracking=None, interval=TICK):
    """A gate around predictions at `best` and `motion` [m]."""
    by_motion = predicted(motion, covariance)
    if not external:
        return Gate(Predictions(by_motion, by_motion, None, interval, 0.0), tracking or Tracking(), P)
    prior = Prior(SE2(best), covariance)
    predictions = Predictions(predicted(best, covariance, None), by_motion, prior, interval, 0.0)
    return Gate(predictions, tracking or Tracking(), P)


def verdict(gate, x, *args, has_tentative=False, **options):
    return gate.check(SE2(x), result(*args, **options), has_tentative)


@pytest.mark.parametrize(('x', 'theta', 'lost', 'reason'), [
    (0.53, 0.0, 0.0, None), (0.55, 0.0, 0.0, Reason.TOO_FAST), (0.55, 0.0, 0.1, None),
    (0.0, 0.66, 0.0, None), (0.0, 0.68, 0.0, Reason.TURNS_TOO_FAST), (0.0, -0.68, 0.1, None)])
def test_a_result_faster_than_the_limits_since_the_last_scan_found_is_rejected(x, theta, lost, reason):
    """5 m/s and 6.3 rad/s for 0.1 s, and the gate of a sensor at rest: 0.04 m, 0.04 rad."""
    tested = gate(covariance=np.eye(3), tracking=Tracking(found=SE2(), lost_time=lost))
    found = tested.check(SE2(x, 0.0, theta), result())
    assert found == ((Decision.REJECT, reason) if reason else (Decision.ACCEPT, Reason.WITHIN_GATE))


@pytest.mark.parametrize(('score', 'lost', 'decision'), [
    (0.43, 0.0, Decision.REJECT), (0.46, 0.0, Decision.ACCEPT), (0.2, 0.0, Decision.REJECT),
    (0.2, 0.9, Decision.ACCEPT)])
def test_outside_the_gate_a_result_has_to_score_like_a_moment_ago(score, lost, decision):
    tested = gate(tracking=Tracking(score=0.9, lost_time=lost))
    found = tested.check(SE2(0.5), dataclasses.replace(result(), score=score))
    assert found.decision is decision
    assert found.reason is (Reason.POOR_SCORE if decision is Decision.REJECT else Reason.UNKNOWN_MOTION)


@pytest.mark.parametrize(('status', 'x', 'tracking', 'expected'), [
    (Status.OK, 0.45, Tracking(), (Decision.ACCEPT, Reason.SCAN_BEFORE)),
    (Status.OK, 0.55, Tracking(lost_time=3.0), (Decision.REJECT, Reason.TOO_FAST)),
    (Status.OK, 0.45, Tracking(score=0.9), (Decision.REJECT, Reason.POOR_SCORE)),
    (Status.DEGENERATE, 0.0, Tracking(), (Decision.REJECT, Reason.UNRELIABLE)),
    (Status.FAILED, 0.0, Tracking(), (Decision.REJECT, Reason.FAILED))])
def test_a_scan_that_is_not_found_in_the_map_may_be_registered_to_the_scan_before(status, x, tracking, expected):
    assert gate(tracking=tracking).check_scan_before(SE2(), SE2(x), result(status)) == expected


def test_after_a_weak_prediction_an_unreliable_result_is_a_better_guess():
    weak = gate(covariance=np.diag((1.0, 1.0, 0.5)) ** 2)
    for confidence, reason in ((0.02, Reason.GUESS), (0.005, Reason.FAILED)):
        found = dataclasses.replace(result(Status.FAILED), confidence=confidence)
        assert weak.check_scan_before(SE2(), SE2(0.3), found) == (Decision.REJECT, reason)


@pytest.mark.parametrize(('status', 'confidence', 'tentative', 'decision'), [
    (Status.AMBIGUOUS, 0.51, None, Decision.ACCEPT), (Status.AMBIGUOUS, 0.49, None, Decision.REJECT),
    (Status.DEGENERATE, 0.9, None, Decision.REJECT),
    (Status.AMBIGUOUS, 0.49, Status.DEGENERATE, Decision.REJECT),
    (Status.AMBIGUOUS, 0.51, Status.DEGENERATE, Decision.ACCEPT),
    (Status.DEGENERATE, 0.49, Status.DEGENERATE, Decision.REJECT),
    (Status.DEGENERATE, 0.51, Status.DEGENERATE, Decision.ACCEPT),
    (Status.AMBIGUOUS, 0.7, Status.AMBIGUOUS, Decision.ACCEPT),
    (Status.AMBIGUOUS, 0.55, Status.AMBIGUOUS, Decision.REJECT),
    (Status.DEGENERATE, 0.7, Status.AMBIGUOUS, Decision.ACCEPT)])
def test_after_a_weak_prediction_the_more_likely_result_is_believed(status, confidence, tentative, decision):
    """Of the tentative result with the map, at a confidence of 0.6, and the one with the scan before."""
    weak = gate(covariance=np.diag((1.0, 1.0, 0.5)) ** 2)
    found = dataclasses.replace(result(status), confidence=confidence)
    if tentative is not None:
        tentative = dataclasses.replace(result(tentative), confidence=0.6)
    verdict = weak.check_scan_before(SE2(), SE2(0.3), found, tentative)
    assert verdict == (decision, Reason.SCAN_BEFORE if decision is Decision.ACCEPT else Reason.GUESS)


def test_a_degenerate_result_replaces_another_only_within_the_gate():
    """It has to lie within 0.7 of the gate of 4 m, as corridors are symmetric."""
    weak, less = gate(covariance=np.diag((1.0, 1.0, 0.5)) ** 2), result(Status.DEGENERATE)
    more = dataclasses.replace(less, confidence=0.6)
    assert weak.check_scan_before(SE2(), SE2(0.0, 0.0, 0.1), more, less).decision is Decision.ACCEPT
    far = gate(motion=3.0, covariance=np.diag((1.0, 1.0, 0.5)) ** 2)
    assert far.check_scan_before(SE2(), SE2(0.1), more, less).decision is Decision.REJECT


@pytest.mark.parametrize(('points', 'decision'), [(0.6, Decision.ACCEPT), (0.4, Decision.REJECT)])
def test_a_degenerate_result_replaces_another_only_if_it_is_constrained_half_as_well(points, decision):
    weak = gate(covariance=np.diag((1.0, 1.0, 0.5)) ** 2)
    less = dataclasses.replace(result(Status.DEGENERATE), weakest_information=1.0)
    more = dataclasses.replace(less, confidence=0.6, weakest_information=points)
    assert weak.check_scan_before(SE2(), SE2(0.0, 0.0, 0.1), more, less).decision is decision


@pytest.mark.parametrize(('status', 'x', 'decision'), [
    (Status.OK, 3.9, Decision.ACCEPT), (Status.OK, 4.1, Decision.REJECT), (Status.AMBIGUOUS, 0.0, Decision.REJECT)])
def test_the_map_before_a_loss_is_rejoined_only_by_an_ok_result_within_the_gate(status, x, decision):
    found = gate().check_lost_map(SE2(), np.eye(3), SE2(x), result(status))
    assert found.decision is decision
    assert (found.reason is Reason.REJOINED) is (decision is Decision.ACCEPT)


@pytest.mark.parametrize(('reason', 'x', 'tracking', 'correction'), [
    (Reason.WITHIN_GATE, 1.0, Tracking(mode=Mode.TRACKING), False),
    (Reason.REJOINED, 0.0, Tracking(mode=Mode.TRACKING), True),
    (Reason.UNKNOWN_MOTION, 0.09, Tracking(mode=Mode.TRACKING), False),
    (Reason.UNKNOWN_MOTION, 0.11, Tracking(mode=Mode.TRACKING), True),
    (Reason.UNKNOWN_MOTION, 0.11, Tracking(), False),
    (Reason.UNKNOWN_MOTION, 0.09, Tracking(mode=Mode.COASTING, lost_time=0.1), True)])
def test_a_result_far_from_the_prediction_is_a_correction_and_not_ok(reason, x, tracking, correction):
    """0.1 m in 0.1 s are the 1 m/s by which a speed may differ; the second scan of a track has no prediction."""
    tested, found = gate(tracking=tracking), Verdict(Decision.ACCEPT, reason)
    assert tested.is_correction(SE2(x), found) is correction
    status = tested.demoted(SE2(x), result(), found, None).status
    assert status is (Status.AMBIGUOUS if correction else Status.OK)


def test_a_chain_is_not_ok_before_it_is_found_in_the_map():
    assert gate().demoted(SE2(), result(), WITHIN, Reason.SCAN_BEFORE).status is Status.AMBIGUOUS


@pytest.mark.parametrize(('x', 'status', 'has_tentative', 'decision', 'reason'), [
    (0.0, Status.FAILED, False, Decision.REJECT, Reason.FAILED),
    (0.039, Status.OK, False, Decision.ACCEPT, Reason.WITHIN_GATE),
    (0.039, Status.AMBIGUOUS, False, Decision.ACCEPT, Reason.WITHIN_GATE),
    (0.0, Status.DEGENERATE, False, Decision.TENTATIVE, Reason.INCONCLUSIVE),
    (0.0, Status.AMBIGUOUS, True, Decision.TENTATIVE, Reason.INCONCLUSIVE),
    (0.0, Status.OK, True, Decision.ACCEPT, Reason.WITHIN_GATE),
    (0.041, Status.AMBIGUOUS, False, Decision.REJECT, Reason.UNRELIABLE),
    (0.041, Status.OK, True, Decision.REJECT, Reason.UNRELIABLE),
    (0.5, Status.OK, False, Decision.ACCEPT, Reason.UNKNOWN_MOTION),
    (3.0, Status.OK, False, Decision.REJECT, Reason.OUTSIDE)])
def test_a_result_is_judged_by_its_status_and_its_distance(x, status, has_tentative, decision, reason):
    direction = 0.0 if status is Status.DEGENERATE else None
    found = verdict(gate(), x, status, direction=direction, has_tentative=has_tentative)
    assert found == (decision, reason)


@pytest.mark.parametrize(('ratio', 'accepted'), [(0.69, True), (0.71, False)])
@pytest.mark.parametrize('weak', [np.diag((0.51, 0.51, 0.01)) ** 2, np.diag((0.01, 0.01, 0.4)) ** 2],
                         ids=['translation', 'rotation'])
def test_after_a_weak_prior_an_ambiguous_result_has_to_be_nearer(weak, ratio, accepted):
    """A prior is weak above 0.5 m, or where its gate allows a quarter turn; then 0.7 of the gate counts."""
    reach = ratio * P.prior.gate * math.sqrt(weak[0, 0])
    expected = (Decision.ACCEPT, Reason.WITHIN_GATE) if accepted else (Decision.REJECT, Reason.UNRELIABLE)
    assert verdict(gate(covariance=weak), reach, Status.AMBIGUOUS) == expected
    assert verdict(gate(covariance=weak), reach) == (Decision.ACCEPT, Reason.WITHIN_GATE)


@pytest.mark.parametrize(('information', 'expected'), [
    (MANY, (Decision.ACCEPT, Reason.UNKNOWN_MOTION)), (FEW, (Decision.REJECT, Reason.UNRELIABLE))])
def test_results_by_few_points_do_not_override_the_wheels(information, expected):
    """Wheel odometry 3.5 cm, motion model 0, scan -1 cm; the two predictions agree."""
    assert verdict(gate(0.035, 0.0, external=True), -0.01, information=information) == expected


def test_after_coasting_few_points_override_the_wheels():
    late = Tracking(lost_time=P.odometry.coast_time + 0.1)
    assert verdict(gate(0.035, 0.0, external=True, tracking=late), -0.01, information=FEW).decision is Decision.ACCEPT
    early = Tracking(lost_time=P.odometry.coast_time - 0.1)
    assert verdict(gate(0.035, 0.0, external=True, tracking=early), -0.01, information=FEW).decision is Decision.REJECT


@pytest.mark.parametrize(('status', 'x', 'tracking', 'asks'), [
    (Status.AMBIGUOUS, 0.5, Tracking(), True), (Status.DEGENERATE, 0.5, Tracking(), True),
    (Status.OK, 0.5, Tracking(), False), (Status.FAILED, 0.5, Tracking(), False),
    (Status.AMBIGUOUS, 0.03, Tracking(), False), (Status.AMBIGUOUS, 0.5, Tracking(lost_time=0.1), False)])
def test_a_search_within_the_gate_follows_a_result_outside_that_is_not_ok(status, x, tracking, asks):
    assert gate(tracking=tracking).asks_for_search_within(SE2(x), result(status)) is asks


def precise_wheels():
    """Wheels ten times as precise as their covariance."""
    wheels = WheelCalibration()
    for _ in range(1000):
        wheels.learn(Prior(SE2(0.5, 0.2, 0.3), SIGMA), SE2(0.5, 0.2, 0.3), 1.0, 300.0)
    return wheels


def test_wheels_that_proved_precise_are_tightened_where_the_match_agrees():
    at = gate(0.0, 0.0, external=True)
    assert at.used_prior(SE2(0.004), precise_wheels()).covariance[0, 0] < 0.1 * SIGMA[0, 0]
    assert at.used_prior(SE2(0.03), precise_wheels()).covariance[0, 0] == SIGMA[0, 0]
    assert gate().used_prior(SE2(), precise_wheels()).covariance[0, 0] == SIGMA[0, 0]


def test_a_prior_that_the_match_contradicts_has_no_information():
    at = gate()
    prior = at.predictions.best.prior
    np.testing.assert_allclose(at.prior_information(SE2(0.039), prior), np.linalg.inv(SIGMA))
    np.testing.assert_array_equal(at.prior_information(SE2(0.041), prior), np.zeros((3, 3)))


@pytest.mark.parametrize(('x', 'status', 'interval', 'moves'), [
    (0.051, Status.OK, TICK, True), (0.049, Status.OK, TICK, False), (0.051, Status.DEGENERATE, TICK, False),
    (0.051, Status.OK, ScanInterval(0.0, 0.0, 0.0), False), (0.051, Status.OK, ScanInterval(0.1, 3.0, 0.0), False)])
def test_a_start_in_motion_is_proved_beyond_the_zero_velocity_gate(x, status, interval, moves):
    """Five standard deviations of 1 cm."""
    assert gate(interval=interval).starts_in_motion(SE2(x), result(status), SE2()) is moves


def test_few_points_after_a_weak_prior_are_no_longer_ok():
    weak = np.diag((0.51, 0.51, 0.01)) ** 2
    assert gate(covariance=weak).demoted(SE2(), result(information=FEW), WITHIN, None).status is Status.DEGENERATE
    assert gate(covariance=weak).demoted(SE2(), result(information=MANY), WITHIN, None).status is Status.OK
    assert gate().demoted(SE2(), result(information=FEW), WITHIN, None).status is Status.OK


@pytest.mark.parametrize('length', [0.0, 0.005])
@pytest.mark.parametrize(('x', 'correction'), [(0.03, False), (0.05, True)])
def test_scans_of_two_sensors_at_one_time_may_differ_by_the_gate_of_a_sensor_at_rest(length, x, correction):
    interval = ScanInterval(length, length, 0.0, of_others=True)
    tested = gate(interval=interval, tracking=Tracking(mode=Mode.TRACKING))
    assert tested.is_correction(SE2(x), Verdict(Decision.TENTATIVE, Reason.INCONCLUSIVE)) is correction
