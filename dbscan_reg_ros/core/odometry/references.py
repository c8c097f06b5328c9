# SPDX-License-Identifier: Apache-2.0
"""References to which a scan is registered one after the other, until the gate accepts a result."""
import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..features.records import Features
from ..geometry.array_types import FloatArray
from ..geometry.se2 import DOF, SE2
from ..geometry.ties import order_up_to_rounding
from ..mapping.key_frame import KeyFrame
from ..parameters.tree import Parameters
from ..registration.records import Registration, Status
from ..registration.status import spread
from .prediction import Prediction
from .state import TrackState
from .verdict import LIMITS, Decision, Reason, Verdict


class Reference(NamedTuple):
    """Features to which a scan is registered, in the frame of a key frame."""

    key_frame: KeyFrame
    features: Features


@dataclass(frozen=True, eq=False)
class Match:
    """Result of registering a scan to one reference.

    Attributes
    ----------
    key_frame : KeyFrame
        Key frame of the reference.
    pose : SE2
        Pose of the scan in the odometry frame; along a degenerate direction the position is the predicted one.
    unresolved_direction : float or None [rad]
        The `degenerate_direction`; if it is None, that of an earlier tentative match.
    registration : Registration
    features : Features
        Features of the scan without dynamic points.
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
        """Degenerate direction [rad] of this registration in the odometry frame; None if no direction is degenerate."""
        return degenerate_direction(self.key_frame, self.registration)

    def mixture_covariance(self, predicted: Prediction) -> FloatArray:
        """Return the covariance ``(3, 3)`` that other poses add to that of this one, in the frame of the scan.

        The others are the rivals of the registration and, if none of its hypotheses is right, the `predicted` pose. A
        mixture with weights w, covariances P and offsets d from this pose has the covariance sum of w (P + d d^T).
        """
        registration, certainty = self.registration, self.registration.confidence
        if 1.0 - certainty < _CERTAIN or not registration.hypotheses:
            return np.zeros((DOF, DOF))
        weights = [certainty * math.exp(min(each.log_odds - registration.hypotheses[0].log_odds, 0.0))
                   for each in registration.rivals]
        poses = [self.key_frame.pose @ each.transform for each in registration.rivals]
        none = max(1.0 - certainty - sum(weights), 0.0)
        return none * predicted.gate_covariance + spread(self.pose, [predicted.pose, *poses], [none, *weights])


class SearchOutcome(NamedTuple):
    """Result of the search over all references.

    Attributes
    ----------
    match : Match or None
        The match that is used; None if every match was rejected.
    registration : Registration
        Registration of the match; without a match, the registration to the local map.
    search_near : bool
        Whether a search near the prior suffices for the next scan, as in `Tracking`.
    rejoined : Match or None
        The match with the map before the loss, if it is accepted.
    guess : SE2 or None
        Pose of a rejected match that is more likely than the prediction.
    rejection : Reason or None
        Why the gate rejected the first result whose registration did not fail.
    """

    match: Match | None
    registration: Registration
    search_near: bool = True
    rejoined: Match | None = None
    guess: SE2 | None = None
    rejection: Reason | None = None

    @property
    def is_certain(self) -> bool:
        """Whether there is a match that is accepted and ``OK``."""
        match = self.match
        return (match is not None and match.verdict.decision is Decision.ACCEPT
                and match.registration.status is Status.OK)

    @property
    def rejected(self) -> Registration:
        """The registration to the local map, with the reason for which the gate rejected a result."""
        registration, rejection = self.registration, self.rejection
        if rejection is None:
            return registration
        failed = registration.status is Status.FAILED or rejection in LIMITS
        return dataclasses.replace(registration, status=Status.FAILED if failed else Status.AMBIGUOUS,
                                   reason='; '.join(filter(None, (registration.reason, rejection.value))))

    def joined(self, match: Match) -> 'SearchOutcome':
        """Add a match: an accepted match replaces the present one, a tentative match is used only if there is none."""
        verdict = match.verdict
        if verdict.decision is Decision.ACCEPT or (verdict.decision is Decision.TENTATIVE and self.match is None):
            return self._replace(match=match, registration=match.registration)
        if verdict.decision is not Decision.REJECT or verdict.reason is Reason.FAILED:
            return self
        return self._without(match)

    def _without(self, match: Match) -> 'SearchOutcome':
        """Store from a rejected `match` a better guess and the first reason."""
        verdict = match.verdict
        if verdict.reason is Reason.GUESS:
            return self if self.guess else self._replace(guess=match.pose)
        return self if self.rejection else self._replace(rejection=verdict.reason)


def fallback_references(state: TrackState, predicted: SE2, first: Registration,
                        parameters: Parameters, sensor: str = '') -> list[Reference]:
    """List the references of a sensor to try after its local map, in order.

    ==================== ====================================================================================
    reference            condition
    ==================== ====================================================================================
    latest key frame     the score of the local map is recoverable, and the map has more than this key frame
    last scan            it is no key frame, found or not, the prediction is rotated from the latest key frame by
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
    sensor : str
        Name of the sensor of the scan.
    """
    p, window, references = parameters.odometry, state.key_frames, []
    *older, latest = window.frames_of(sensor)
    recoverable = is_recoverable(first, parameters)
    if recoverable and window.local_map_of(sensor) is not latest.features:
        references.append(Reference(latest, latest.features))
    rotation, last_scan = abs((latest.pose.inverse() @ predicted).theta), state.tracking.last_scan_of(sensor)
    if last_scan is not None and rotation > p.key_frame_angle and first.status is Status.FAILED:
        references.append(Reference(last_scan, last_scan.features))
    nearest = nearest_first([latest, *older], predicted)
    older = [frame for frame in (nearest if recoverable else nearest[:nearest.index(latest)]) if frame is not latest]
    return references + [Reference(frame, frame.features) for frame in older[:p.older_key_frames]]


def nearest_first(frames: Sequence[KeyFrame], pose: SE2) -> list[KeyFrame]:
    """Return key frames by their distance from a `pose`."""
    distance = np.array([math.hypot(frame.pose.x - pose.x, frame.pose.y - pose.y) for frame in frames])
    return [frames[k] for k in order_up_to_rounding(distance).tolist()]


def is_recoverable(registration: Registration, parameters: Parameters) -> bool:
    """Whether the score of a registration is high enough for a retry, should it fail."""
    return registration.score >= _RECOVERABLE_RATIO * parameters.decision.min_score


def degenerate_direction(frame: KeyFrame, registration: Registration) -> float | None:
    """Return the degenerate direction [rad] of a registration to a key frame in the odometry frame, or None."""
    direction = registration.degenerate_direction
    return None if direction is None else frame.pose.theta + direction


def unresolved_direction(frame: KeyFrame, registration: Registration, before: float | None) -> float | None:
    """Return the `degenerate_direction` of a registration; without one, the direction `before` of earlier results."""
    direction = degenerate_direction(frame, registration)
    return before if direction is None else direction


def predicted_along_degenerate(frame: KeyFrame, registration: Registration, predicted: SE2) -> SE2:
    """Return the pose of a registered scan in the odometry frame, as `predicted` along a degenerate direction."""
    pose, direction = frame.pose @ registration.transform, degenerate_direction(frame, registration)
    if direction is None:
        return pose
    c, s = math.cos(direction), math.sin(direction)
    distance = c * (predicted.x - pose.x) + s * (predicted.y - pose.y)
    return SE2(pose.x + distance * c, pose.y + distance * s, pose.theta)


def search_parameters(parameters: Parameters) -> Parameters:
    """Return the parameters of registrations to single references.

    The gate checks their results as well, so that more errors are allowed than by `decision.min_confidence` alone.
    If the scan is aligned with the window afterwards, that alignment is final: the registration is not polished, and
    near-parallel walls count as parallel with the same tolerance as in the window.
    """
    confidence = max(1.0 - _GATED_ERRORS * (1.0 - parameters.decision.min_confidence), 0.0)
    decision = dataclasses.replace(parameters.decision, min_confidence=confidence)
    if parameters.odometry.reference != 'window':
        return dataclasses.replace(parameters, decision=decision)
    tolerance = max(decision.parallel_tolerance, parameters.degeneracy.parallel_tolerance)
    return dataclasses.replace(parameters, decision=dataclasses.replace(decision, parallel_tolerance=tolerance),
                               refinement=dataclasses.replace(parameters.refinement, polish_iterations=0))


_CERTAIN = 1e-6
"""Probability of an error below which no other pose counts."""
_GATED_ERRORS = 2.0
"""Probability of an error that is allowed where the gate checks a result, over that of a result alone."""
_RECOVERABLE_RATIO = 0.3
"""A failed registration is retried if its score is at least this ratio of `decision.min_score`."""
