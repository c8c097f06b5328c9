# SPDX-License-Identifier: Apache-2.0
"""What a scan is registered to, in order, and the results."""
import dataclasses
import math
from dataclasses import dataclass
from typing import NamedTuple

from ..features.records import Features
from ..geometry.se2 import SE2
from ..parameters.tree import Parameters
from ..registration.pipeline import register, register_within_gate
from ..registration.records import Prior, Registration, Status
from .gate import Decision, Gate, Verdict
from .mapping.dynamic_points import without_dynamic_points
from .mapping.key_frame_window import KeyFrame
from .mapping.scan_to_map import facing
from .prediction import Predictions
from .state import TrackState


class Reference(NamedTuple):
    """Features that a scan is registered to, in the frame of a key frame."""

    key_frame: KeyFrame
    features: Features


@dataclass(frozen=True, eq=False)
class Match:
    """The result of registering a scan to one reference.

    Attributes
    ----------
    key_frame : KeyFrame
        The reference's.
    pose : SE2
        Of the scan, in the odometry frame; along a degenerate direction it is level with the prediction.
    direction : float or None [rad]
        In the odometry frame, the degenerate direction.
    registration : Registration
    features : Features
        The scan without its dynamic points.
    verdict : Verdict
    """

    key_frame: KeyFrame
    pose: SE2
    direction: float | None
    registration: Registration
    features: Features
    verdict: Verdict

    @property
    def degenerate_direction(self) -> float | None:
        """``float`` [rad]: the direction in the odometry frame that this registration leaves open, if any."""
        free = self.registration.degenerate_direction
        return None if free is None else self.key_frame.pose.theta + free


class Outcome(NamedTuple):
    """What came of all references.

    Attributes
    ----------
    match : Match or None
        The one that is believed.
    registration : Registration
        Of the match, or of the local map where there is none.
    unconfirmed : SE2 or None
        The first pose outside every gate.
    search_near : bool
        As in `Tracking`.
    """

    match: Match | None
    registration: Registration
    unconfirmed: SE2 | None
    search_near: bool


def fallback_references(state: TrackState, predicted: SE2, first: Registration, parameters: Parameters) -> list[Reference]:
    """References to try after the local map, in order, each with its condition.

    ==================== ====================================================================================
    reference            condition
    ==================== ====================================================================================
    latest key frame     the score of the local map is recoverable, and the map holds more than this key frame
    last scan            it was found and is no key frame, the prediction has turned beyond
                         `odometry.key_frame_angle`, and the local map failed
    older key frames     the nearest `odometry.older_key_frames`; closer to the prediction than the latest where the
                         score of the local map is not recoverable
    ==================== ====================================================================================

    Parameters
    ----------
    state : TrackState
    predicted : SE2
        Predicted pose of the scan in the odometry frame.
    first : Registration
        To the local map.
    parameters : Parameters
    """
    p, window, references = parameters.odometry, state.window, []
    *older, latest = window.frames
    recoverable = is_recoverable(first, parameters)
    if recoverable and window.local_map is not latest.features:
        references.append(Reference(latest, latest.features))
    rotation = abs((latest.pose.inverse() @ predicted).theta)
    if state.tracking.last_scan is not None and rotation > p.key_frame_angle and first.status is Status.FAILED:
        references.append(Reference(state.tracking.last_scan, state.tracking.last_scan.features))

    def distance(frame: KeyFrame) -> float:
        return math.hypot(frame.pose.x - predicted.x, frame.pose.y - predicted.y)
    older = sorted((frame for frame in older if recoverable or distance(frame) < distance(latest)), key=distance)
    return references + [Reference(frame, frame.features) for frame in older[:p.older_key_frames]]


def is_recoverable(registration: Registration, parameters: Parameters) -> bool:
    """Whether the score of a failed registration is high enough for another try."""
    return registration.score >= _RECOVERABLE * parameters.decision.min_score


class ReferenceSearch:
    """Registers one scan to reference after reference until the gate accepts a result.

    Parameters
    ----------
    features : Features
        Of the scan.
    state : TrackState
    predictions : Predictions
    parameters : Parameters
        Of the odometry.
    search_parameters : Parameters
        Of the registrations to single references.
    """

    def __init__(self, features: Features, state: TrackState, predictions: Predictions, parameters: Parameters,
                 search_parameters: Parameters):
        self._features, self._state, self._predictions = features, state, predictions
        self._parameters, self._search_parameters = parameters, search_parameters
        self._gate = Gate(predictions, state.tracking, parameters)
        self._search_near = state.tracking.search_near

    def run(self) -> Outcome:
        """Register to the local map, and where that is not final to `fallback_references`."""
        state, predicted = self._state, self._predictions.best.pose
        precise = self._predictions.best.prior.translation_sigma < self._parameters.odometry.dynamic_margin
        static = without_dynamic_points(self._features, predicted, state.window, self._parameters) if precise else self._features
        match = self._match(Reference(state.window.latest, state.window.local_map), static, None)
        first, outcome = match.registration, Outcome(None, match.registration, None, True)
        outcome = self._joined(outcome, match)
        if not self._is_final(match):
            for reference in fallback_references(state, predicted, first, self._parameters):
                match = self._match(reference, static, outcome.match)
                outcome = self._joined(outcome, match)
                if self._is_final(match):
                    break
        return outcome._replace(search_near=self._search_near)

    @staticmethod
    def _joined(outcome: Outcome, match: Match) -> Outcome:
        """The outcome with one more match: an accepted one is the result, a tentative one unless there is one already."""
        verdict = match.verdict
        if verdict.decision is Decision.ACCEPT or (verdict.decision is Decision.TENTATIVE and outcome.match is None):
            return outcome._replace(match=match, registration=match.registration)
        if verdict.decision is Decision.REJECT and verdict.outlier and outcome.unconfirmed is None:
            return outcome._replace(unconfirmed=match.pose)
        return outcome

    def _is_final(self, match: Match) -> bool:
        """Whether no further reference can say more: the match is accepted, or the scan itself leaves its direction open."""
        if match.verdict.decision is not Decision.TENTATIVE:
            return match.verdict.decision is Decision.ACCEPT
        facing_information = facing(match.features, match.pose, match.direction, self._parameters).sum()
        return match.registration.rotation_unobservable or facing_information < self._parameters.decision.min_information

    def _match(self, reference: Reference, static: Features, tentative: Match | None) -> Match:
        """Register the scan to one reference and have the gate decide on the result."""
        frame, predicted = reference.key_frame, self._predictions.best.pose
        prior = Prior(frame.pose.inverse() @ predicted, self._predictions.best.prior.covariance)
        registration, used = self._register(reference, static, prior)
        direction = tentative and tentative.direction
        pose, direction = level(frame, registration, predicted, direction)
        if self._gate.asks_for_search_within(pose, registration):
            inside = register_within_gate(reference.features, used, self._search_parameters, prior)
            if inside.status is not Status.FAILED:
                registration = dataclasses.replace(inside, status=registration.status, reason=registration.reason)
                pose, direction = level(frame, registration, predicted, direction)
        return Match(frame, pose, direction, registration, used, self._gate.check(pose, registration, tentative is not None))

    def _register(self, reference: Reference, static: Features, prior: Prior) -> tuple[Registration, Features]:
        """Register the `static` points; the features that were used are returned as well.

        Dynamic points are told by the predicted pose. Where a result fails but is recoverable, they are told again by
        the pose that it gives.
        """
        p = self._parameters
        registration = register(reference.features, static, self._search_parameters, prior, self._search_near)
        self._search_near = registration.score > p.prior.max_score_outside_gate
        if registration.status is not Status.FAILED or not is_recoverable(registration, p):
            return registration, static
        pose = reference.key_frame.pose @ registration.transform
        again = without_dynamic_points(self._features, pose, self._state.window, p)
        if again.normals is static.normals:
            return registration, static
        return register(reference.features, again, self._search_parameters, prior), again


def level(frame: KeyFrame, registration: Registration, predicted: SE2, direction: float | None) -> tuple[SE2, float | None]:
    """The pose of a registered scan in the odometry frame, and its degenerate direction [rad]: `direction` where it has none.

    Along a degenerate direction the pose is level with the `predicted` one.
    """
    pose = frame.pose @ registration.transform
    if registration.degenerate_direction is None:
        return pose, direction
    direction = frame.pose.theta + registration.degenerate_direction
    c, s = math.cos(direction), math.sin(direction)
    distance = c * (predicted.x - pose.x) + s * (predicted.y - pose.y)
    return SE2(pose.x + distance * c, pose.y + distance * s, pose.theta), direction


_RECOVERABLE = 0.3
"""Ratio of `decision.min_score` from which on a failed result is worth another try."""
