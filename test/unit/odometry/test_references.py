# SPDX-License-Identifier: Apache-2.0
"""The table of references that follow the local map, and how their results are joined."""
import dataclasses
import math

import numpy as np
import pytest
from rooms import FULL, L_ROOM, look, outline

from dbscan_reg_ros.core.features.extraction import extract_features
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.mapping.key_frame import KeyFrame
from dbscan_reg_ros.core.mapping.key_frame_window import KeyFrameWindow
from dbscan_reg_ros.core.odometry.prediction import Prediction
from dbscan_reg_ros.core.odometry.references import (
    Match,
    SearchOutcome,
    fallback_references,
    predicted_along_degenerate,
)
from dbscan_reg_ros.core.odometry.state import Tracking, TrackState
from dbscan_reg_ros.core.odometry.verdict import Decision, Reason, Verdict
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.records import Hypothesis, Prior, Registration, Status

P = Parameters()
ROOM = outline(L_ROOM)
RECOVERABLE, HOPELESS = 0.31 * P.decision.min_score, 0.29 * P.decision.min_score
POSES = SE2(-1.2, 0.2, 0.1), SE2(-0.9, 0.1, 0.0), SE2(-0.6, 0.2, 0.2), SE2(-0.3, 0.3, 0.3)


@pytest.fixture(scope='module')
def frames():
    return [KeyFrame(extract_features(look(ROOM, pose, FULL, noise=0.0)), pose, number=k) for k,
            pose in enumerate(POSES)]


def registered(status=Status.FAILED, score=RECOVERABLE, direction=None, transform=SE2()):
    return Registration(transform, np.eye(3), status, score=score, degenerate_direction=direction)


def after(frames, last_scan=None):
    state = TrackState.initial(frames[-1].pose, number=0)
    state.window, state.tracking = KeyFrameWindow(frames), Tracking(last_scans=(last_scan,) if last_scan else ())
    return state


def numbers(references):
    return [reference.key_frame.number for reference in references]


def test_older_key_frames_follow_by_their_distance_from_the_prediction(frames):
    assert numbers(fallback_references(after(frames), SE2(-0.7, 0.2), registered(), P)) == [3, 2, 1]
    assert numbers(fallback_references(after(frames), SE2(-1.3, 0.2), registered(), P)) == [3, 0, 1]


def test_where_the_local_map_scored_near_zero_only_key_frames_nearer_than_the_latest_are_tried(frames):
    hopeless = registered(score=HOPELESS)
    assert numbers(fallback_references(after(frames), POSES[-1], hopeless, P)) == []
    assert numbers(fallback_references(after(frames), POSES[1], hopeless, P)) == [1, 0]


@pytest.mark.parametrize(('rotation', 'status', 'tried'), [
    (1.1, Status.FAILED, True), (0.9, Status.FAILED, False), (1.1, Status.AMBIGUOUS, False)])
def test_the_last_scan_is_tried_where_the_prediction_is_rotated_and_the_map_failed(frames, rotation, status, tried):
    last = dataclasses.replace(frames[0], number=7)
    predicted = POSES[-1] @ SE2(0.0, 0.0, rotation * P.odometry.key_frame_angle)
    assert (7 in numbers(fallback_references(after(frames, last), predicted, registered(status), P))) is tried
    assert 7 not in numbers(fallback_references(after(frames), predicted, registered(status), P))


def test_along_a_degenerate_direction_the_pose_is_the_predicted_one(frames):
    """The key frame faces 0.3 rad; the registration is degenerate along its x axis."""
    frame, predicted = frames[-1], POSES[-1] @ SE2(0.5, 0.1)
    degenerate = registered(Status.DEGENERATE, direction=0.0, transform=SE2(0.2, 0.04, 0.1))
    found = frame.pose.inverse() @ predicted_along_degenerate(frame, degenerate, predicted)
    assert found.as_array() == pytest.approx([0.5, 0.04, 0.1])
    sure = registered(Status.OK, transform=SE2(0.2, 0.04, 0.1))
    assert predicted_along_degenerate(frame, sure, predicted) == frame.pose @ sure.transform


@pytest.mark.parametrize(('confidence', 'rival', 'none'), [(0.6, 0.2, 0.2), (0.9, 0.0, 0.1), (1.0 - 1e-9, 0.0, 0.0)])
def test_the_covariance_of_the_mixture_is_its_spread_about_the_pose(frames, confidence, rival, none):
    """A rival 2 m to the left of the key frame that faces 0.3 rad; predicted is 0.5 m ahead of the pose."""
    odds = math.log(rival / confidence) if rival else 0.0
    best, other = Hypothesis(SE2(), 0.9, 1.0), Hypothesis(SE2(0.0, 2.0), 0.8, 1.0 + odds)
    found = dataclasses.replace(registered(Status.AMBIGUOUS), confidence=confidence, hypotheses=(best, other),
                                rivals=(other,) if rival else ())
    pose = frames[-1].pose
    tested = match(frames[-1], Decision.ACCEPT, Reason.WITHIN_GATE)
    tested = dataclasses.replace(tested, pose=pose, registration=found)
    sigma = np.diag((0.1, 0.2, 0.3)) ** 2
    predicted = Prediction(pose @ SE2(0.5), Prior(SE2(), sigma), sigma)
    expected = rival * np.diag((0.0, 4.0, 0.0)) + none * (sigma + np.diag((0.25, 0.0, 0.0)))
    np.testing.assert_allclose(tested.mixture_covariance(predicted), expected, atol=1e-9)


def match(frame, decision, reason, x=0.0):
    return Match(frame, SE2(x), None, registered(), frame.features, Verdict(decision, reason))


def test_results_are_joined_by_their_verdicts(frames):
    first = SearchOutcome(None, registered())
    tentative, second = (match(frames[0], Decision.TENTATIVE, Reason.INCONCLUSIVE) for _ in range(2))
    accepted = match(frames[0], Decision.ACCEPT, Reason.WITHIN_GATE)
    rejected = match(frames[0], Decision.REJECT, Reason.UNRELIABLE)
    assert first.joined(rejected) == first._replace(rejection=Reason.UNRELIABLE)
    assert first.joined(tentative).match is tentative
    assert first.joined(tentative).joined(second).match is tentative
    assert first.joined(tentative).joined(accepted).match is accepted
    assert first.joined(rejected).joined(match(frames[0], Decision.REJECT, Reason.OUTSIDE)) == first.joined(rejected)
