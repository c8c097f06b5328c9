# SPDX-License-Identifier: Apache-2.0
"""References that a scan is registered to, in order, until the gate accepts a result."""
import dataclasses
import math
from dataclasses import dataclass
from typing import NamedTuple

from ..features.records import Features
from ..geometry.se2 import SE2
from ..parameters.tree import Parameters
from ..registration.pipeline import register, register_within_gate
from ..registration.records import Prior, Registration, Status
from ..registration.search import SearchStage
from .gate import Decision, Gate, Reason, Verdict
from .mapping.dynamic_points import without_dynamic_points
from .mapping.key_frame import KeyFrame
from .mapping.scan_to_map import information_along
from .state import TrackState


class Reference(NamedTuple):
    """Features that a scan is registered to, in the frame of a key frame."""

    key_frame: KeyFrame
    features: Features


@dataclass(frozen=True, eq=False)
class Match:
    """Result of registering a scan to one reference.

    Attributes
    ----------
    key_frame : KeyFrame
        That of the reference.
    pose : SE2
        Pose of the scan in the odometry frame; along a degenerate direction it is the predicted one.
    unresolved_direction : float or None [rad]
        `degenerate_direction`; without one, that of the tentative match before.
    registration : Registration
    features : Features
        The scan without its dynamic points.
    verdict : Verdict
    """

    key_frame: KeyFrame
    pose: SE2
    unresolved_direction: float | None
    registration: Registration
    features: Features
    verdict: Verdict

    @property
    def degenerate_direction(self) -> float | None:
        """Degenerate direction [rad] of this registration in the odometry frame; None without one."""
        return degenerate_direction(self.key_frame, self.registration)


class Outcome(NamedTuple):
    """Result of the search over all references.

    Attributes
    ----------
    match : Match or None
        The match that is believed.
    registration : Registration
        That of the match; without one, that of the local map.
    unconfirmed : SE2 or None
        The first pose that the next scan may confirm.
    search_near : bool
        As in `Tracking`.
    rejection : Reason or None
        Why the gate rejected the first result whose registration did not fail.
    """

    match: Match | None
    registration: Registration
    unconfirmed: SE2 | None = None
    search_near: bool = True
    rejection: Reason | None = None

    def joined(self, match: Match) -> 'Outcome':
        """Add a match: an accepted one replaces the match, a tentative one only if there is none."""
        verdict = match.verdict
        if verdict.decision is Decision.ACCEPT or (verdict.decision is Decision.TENTATIVE and self.match is None):
            return self._replace(match=match, registration=match.registration)
        if verdict.decision is not Decision.REJECT or verdict.reason is Reason.FAILED:
            return self
        outcome = self if self.rejection else self._replace(rejection=verdict.reason)
        return outcome._replace(unconfirmed=match.pose) if verdict.outlier and self.unconfirmed is None else outcome


def fallback_references(state: TrackState, predicted: SE2, first: Registration,
                        parameters: Parameters) -> list[Reference]:
    """List the references to try after the local map, in order.

    ==================== ====================================================================================
    reference            condition
    ==================== ====================================================================================
    latest key frame     the score of the local map is recoverable, and the map has more than this key frame
    last scan            it was found and is no key frame, the prediction is rotated from the latest key frame by
                         more than `odometry.key_frame_angle`, and the local map failed
    older key frames     the nearest `odometry.older_key_frames`; only those closer to the prediction than the
                         latest where the score of the local map is not recoverable
    ==================== ====================================================================================

    Parameters
    ----------
    state : TrackState
    predicted : SE2
        Predicted pose of the scan in the odometry frame.
    first : Registration
        Registration to the local map.
    parameters : Parameters
    """
    p, window, references = parameters.odometry, state.key_frames, []
    *older, latest = window.frames
    recoverable = is_recoverable(first, parameters)
    if recoverable and window.local_map is not latest.features:
        references.append(Reference(latest, latest.features))
    rotation, last_scan = abs((latest.pose.inverse() @ predicted).theta), state.tracking.last_scan
    if last_scan is not None and rotation > p.key_frame_angle and first.status is Status.FAILED:
        references.append(Reference(last_scan, last_scan.features))

    def distance(frame: KeyFrame) -> float:
        return math.hypot(frame.pose.x - predicted.x, frame.pose.y - predicted.y)
    older = sorted((frame for frame in older if recoverable or distance(frame) < distance(latest)), key=distance)
    return references + [Reference(frame, frame.features) for frame in older[:p.older_key_frames]]


def is_recoverable(registration: Registration, parameters: Parameters) -> bool:
    """Whether the score of a registration is high enough for a retry, should it fail."""
    return registration.score >= _RECOVERABLE_RATIO * parameters.decision.min_score


class ReferenceSearch:
    """Registers one scan to reference after reference until the gate accepts a result.

    Parameters
    ----------
    features : Features
        Of the scan.
    state : TrackState
    gate : Gate
    parameters : Parameters
        Of the odometry.
    search_parameters : Parameters
        Of the registrations to single references.
    """

    def __init__(self, features: Features, state: TrackState, gate: Gate, parameters: Parameters,
                 search_parameters: Parameters):
        self._features, self._state, self._gate = features, state, gate
        self._parameters, self._search_parameters = parameters, search_parameters
        self._search_near = state.tracking.search_near

    def run(self) -> Outcome:
        """Register to the local map, and unless its match is final to `fallback_references`."""
        window, best = self._state.key_frames, self._gate.predictions.best
        static = self._features
        if best.prior.translation_sigma < self._parameters.odometry.dynamic_margin:
            static = without_dynamic_points(static, best.pose, window, self._parameters)
        match = self._match(Reference(window.latest, window.local_map), static, None)
        outcome = Outcome(None, match.registration).joined(match)
        if not self._is_final(match):
            for reference in fallback_references(self._state, best.pose, match.registration, self._parameters):
                match = self._match(reference, static, outcome.match)
                outcome = outcome.joined(match)
                if self._is_final(match):
                    break
        return outcome._replace(search_near=self._search_near)

    def _is_final(self, match: Match) -> bool:
        """Whether no reference can improve the match: it is accepted, or the scan itself leaves it degenerate."""
        if match.verdict.decision is not Decision.TENTATIVE:
            return match.verdict.decision is Decision.ACCEPT
        if match.registration.rotation_unobservable or match.unresolved_direction is None:
            return True
        information = information_along(match.features, match.pose, match.unresolved_direction, self._parameters).sum()
        return bool(information < self._parameters.decision.min_information)

    def _match(self, reference: Reference, static: Features, tentative: Match | None) -> Match:
        """Register the `static` points to one reference, and let the gate decide on the result."""
        frame, best = reference.key_frame, self._gate.predictions.best
        prior = Prior(frame.pose.inverse() @ best.pose, best.prior.covariance)
        registration, features = self._register(reference, static, prior)
        pose = predicted_along_degenerate(frame, registration, best.pose)
        before = None if tentative is None else tentative.unresolved_direction
        direction = _unresolved_direction(frame, registration, before)
        if self._gate.asks_for_search_within(pose, registration):
            inside = register_within_gate(reference.features, features, self._search_parameters, prior)
            if inside.status is not Status.FAILED:
                registration = dataclasses.replace(inside, status=registration.status, reason=registration.reason)
                pose = predicted_along_degenerate(frame, registration, best.pose)
                direction = _unresolved_direction(frame, registration, direction)
        verdict = self._gate.check(pose, registration, tentative is not None)
        return Match(key_frame=frame, pose=pose, unresolved_direction=direction, registration=registration,
                     features=features, verdict=verdict)

    def _register(self, reference: Reference, static: Features, prior: Prior) -> tuple[Registration, Features]:
        """Register the `static` points; also return the features that were used.

        The predicted pose determines the dynamic points. Where the registration fails but is recoverable, its result
        determines them again, and the registration is retried.
        """
        p = self._parameters
        stage = SearchStage.NEAR if self._search_near else SearchStage.NORMAL
        registration = register(reference.features, static, self._search_parameters, prior, stage)
        self._search_near = registration.score > p.prior.max_score_outside_gate
        if registration.status is not Status.FAILED or not is_recoverable(registration, p):
            return registration, static
        pose = reference.key_frame.pose @ registration.transform
        retried = without_dynamic_points(self._features, pose, self._state.key_frames, p)
        if retried.normals is static.normals:
            return registration, static
        return register(reference.features, retried, self._search_parameters, prior), retried


def degenerate_direction(frame: KeyFrame, registration: Registration) -> float | None:
    """Return the degenerate direction [rad] of a registration to a key frame, in the odometry frame, if any."""
    direction = registration.degenerate_direction
    return None if direction is None else frame.pose.theta + direction


def _unresolved_direction(frame: KeyFrame, registration: Registration, before: float | None) -> float | None:
    """Return the `degenerate_direction` of a registration; without one, that of results `before`."""
    direction = degenerate_direction(frame, registration)
    return before if direction is None else direction


def predicted_along_degenerate(frame: KeyFrame, registration: Registration, predicted: SE2) -> SE2:
    """Return the pose of a registered scan in the odometry frame; along a degenerate direction the `predicted` one."""
    pose, direction = frame.pose @ registration.transform, degenerate_direction(frame, registration)
    if direction is None:
        return pose
    c, s = math.cos(direction), math.sin(direction)
    distance = c * (predicted.x - pose.x) + s * (predicted.y - pose.y)
    return SE2(pose.x + distance * c, pose.y + distance * s, pose.theta)


_RECOVERABLE_RATIO = 0.3
"""Ratio of `decision.min_score` from which on a failed result is retried."""
