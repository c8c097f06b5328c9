# SPDX-License-Identifier: Apache-2.0
"""Search: registers a scan to reference after reference, until the gate accepts a result."""
import dataclasses

import numpy as np

from ..features.records import Features
from ..geometry.ties import first_largest
from ..mapping.dynamic_points import without_dynamic_points
from ..mapping.key_frame import KeyFrame
from ..mapping.scan_to_map import expected_observability, information_along
from ..parameters.tree import Parameters
from ..registration.confidence.model import LIKELY
from ..registration.pipeline import register, register_within_gate
from ..registration.problem import SearchStage
from ..registration.records import Prior, Registration, Status
from ..registration.status import demoted_if_poor, place_confidence
from .gate import Gate
from .models.unobserved_motion import displacement_covariance
from .references import (
    Match,
    Reference,
    SearchOutcome,
    fallback_references,
    is_recoverable,
    nearest_first,
    predicted_along_degenerate,
    unresolved_direction,
)
from .state import TrackState
from .verdict import Decision


class ReferenceSearch:
    """Registers one scan to reference after reference until the gate accepts a result.

    Parameters
    ----------
    features : Features
        Features of the scan.
    state : TrackState
    gate : Gate
    parameters : Parameters
        Parameters of the odometry.
    search_parameters : Parameters
        Parameters of the registrations to single references.
    """

    def __init__(self, features: Features, state: TrackState, gate: Gate, parameters: Parameters,
                 search_parameters: Parameters):
        self._features, self._state, self._gate = features, state, gate
        self._parameters, self._search_parameters = parameters, search_parameters
        self._search_near, self._sensor = state.tracking.search_near, gate.sensor.name
        self._margin = parameters.odometry.dynamic_margin

    def run(self) -> SearchOutcome:
        """Register to the local map, or else to the previous scan; after a loss also to the map before the loss."""
        outcome = self._search_map()
        if outcome.match is None or (self._gate.weak_prior and not outcome.is_certain):
            outcome = outcome.joined(self._match_scan_before(outcome.match))
        if self._gate.predictions.interval.missing and not (
                outcome.is_certain and place_confidence(outcome.registration) > LIKELY):
            outcome = outcome._replace(match=None)
        return outcome._replace(search_near=self._search_near, rejoined=self._match_lost_map(outcome.match))

    def _search_map(self) -> SearchOutcome:
        """Register to the local map; unless that match is final, register to the `fallback_references` as well."""
        window, best = self._state.key_frames, self._gate.predictions.best
        static = self._features
        if best.prior.translation_sigma < self._margin:
            static = without_dynamic_points(static, best.pose, window, self._parameters, self._sensor)
        latest = Reference(window.frames_of(self._sensor)[-1], window.local_map_of(self._sensor))
        match = self._match(latest, static, None)
        outcome = SearchOutcome(None, match.registration).joined(match)
        if not self._is_final(match):
            for reference in fallback_references(self._state, best.pose, match.registration, self._parameters,
                                                 self._sensor):
                if not self._may_resolve(reference, static, outcome.match):
                    continue
                match = self._match(reference, static, outcome.match)
                outcome = outcome.joined(match)
                if self._is_final(match):
                    break
        return outcome

    def _may_resolve(self, reference: Reference, static: Features, tentative: Match | None) -> bool:
        """Whether a reference may constrain the direction that a `tentative` match left unresolved.

        From the pose of that match, at least half as many points as needed must constrain it.
        """
        window, p = self._state.key_frames, self._search_parameters
        if tentative is None or tentative.unresolved_direction is None or reference.key_frame not in window.frames:
            return True
        expected = expected_observability(window, reference.key_frame, static, tentative.pose, p)
        return expected.weak >= _MIN_EXPECTED_RATIO * p.decision.min_information

    def _previous_scan(self) -> KeyFrame:
        """Return the previous scan of the sensor, which may be a key frame."""
        frames = self._state.key_frames.frames_of(self._sensor)
        return self._state.tracking.last_scan_of(self._sensor) or max(frames, key=lambda frame: frame.number)

    def _match_scan_before(self, alternative: Match | None) -> Match:
        """Register to the previous scan without a prediction; the `alternative` is the match with the map.

        The previous scan need not have been registered itself. Two scans from distant positions have few poles in
        common: the scan is registered with and without poles, and the more confident result is returned.
        """
        matches = [self._match_pair(poles, alternative) for poles in (False, True)[:1 + bool(self._features.poles)]]
        matches = [each for each in matches if each.verdict.decision is Decision.ACCEPT] or matches
        return matches[first_largest(np.array([each.registration.confidence for each in matches]))]

    def _match_pair(self, with_poles: bool, alternative: Match | None) -> Match:
        """Register to the previous scan, with or without pole features."""
        frame = self._previous_scan()
        reference, current = (
            features if with_poles else features.without_poles()
            for features in (frame.features, self._features))
        registration = demoted_if_poor(register(reference, current, self._search_parameters), self._parameters.decision)
        pose = frame.pose @ registration.transform
        verdict = self._gate.check_scan_before(frame.pose, pose, registration,
                                               None if alternative is None else alternative.registration)
        return Match(key_frame=frame, pose=pose, unresolved_direction=unresolved_direction(frame, registration, None),
                     registration=registration, features=self._features, verdict=verdict)

    def _match_lost_map(self, chained: Match | None) -> Match | None:
        """Register to the map before the loss; `chained` is the match with the scans since the loss."""
        lost, best = self._state.tracking.lost, self._gate.predictions.best
        if lost is None or lost.window is self._state.window:
            return None
        expected = best.pose if chained is None else chained.pose
        covariance = best.prior.covariance + displacement_covariance(lost.time, self._parameters)
        frames, parameters = lost.window.frames_of(self._sensor), self._search_parameters
        nearest = nearest_first(frames, expected)[:self._parameters.odometry.older_key_frames]
        if lost.gap:
            covariance, parameters = covariance + self._state.covariance.unobserved, self._parameters
            nearest = [frames[self._state.output.number % len(frames)]]
        references = [Reference(frame, frame.features) for frame in nearest]
        for frame, features in (Reference(frames[-1], lost.window.local_map_of(self._sensor)), *references):
            prior = Prior(frame.pose.inverse() @ expected, covariance)
            registration = register(features, self._features, parameters, prior, SearchStage.NORMAL)
            pose = frame.pose @ registration.transform
            verdict = self._gate.check_lost_map(expected, covariance, pose, registration)
            if verdict.decision is Decision.ACCEPT and (not lost.gap or place_confidence(registration) > LIKELY):
                return Match(key_frame=frame, pose=pose, unresolved_direction=None, registration=registration,
                             features=self._features, verdict=verdict)
        return None

    def _is_final(self, match: Match) -> bool:
        """Whether no other reference can improve the match: it is accepted, or degenerate due to the scan itself."""
        if match.verdict.decision is not Decision.TENTATIVE:
            return match.verdict.decision is Decision.ACCEPT
        if match.registration.rotation_unobservable or match.unresolved_direction is None:
            return True
        information = information_along(match.features, match.pose, match.unresolved_direction, self._parameters)
        return information < self._parameters.decision.min_information

    def _match(self, reference: Reference, static: Features, tentative: Match | None) -> Match:
        """Register the `static` points to one reference, and let the gate decide on the result."""
        frame, best = reference.key_frame, self._gate.predictions.best
        prior = Prior(frame.pose.inverse() @ best.pose, best.prior.covariance)
        registration, features = self._register(reference, static, prior)
        pose = predicted_along_degenerate(frame, registration, best.pose)
        before = None if tentative is None else tentative.unresolved_direction
        direction = unresolved_direction(frame, registration, before)
        if self._gate.asks_for_search_within(pose, registration):
            inside = register_within_gate(reference.features, features, self._search_parameters, prior)
            if inside.status is not Status.FAILED:
                registration = dataclasses.replace(inside, status=registration.status, reason=registration.reason)
                pose = predicted_along_degenerate(frame, registration, best.pose)
                direction = unresolved_direction(frame, registration, direction)
        verdict = self._gate.check(pose, registration, tentative is not None)
        return Match(key_frame=frame, pose=pose, unresolved_direction=direction, registration=registration,
                     features=features, verdict=verdict)

    def _register(self, reference: Reference, static: Features, prior: Prior) -> tuple[Registration, Features]:
        """Register the `static` points; also return the features that were used.

        The dynamic points are determined at the predicted pose. If the registration fails but its score is recoverable,
        they are determined again at the registered pose, and the registration is retried.
        """
        p = self._parameters
        stage = SearchStage.NEAR if self._search_near else SearchStage.NORMAL
        registration = register(reference.features, static, self._search_parameters, prior, stage)
        self._search_near = registration.score > p.prior.max_score_outside_gate
        if registration.status is not Status.FAILED or not is_recoverable(registration, p):
            return registration, static
        pose = reference.key_frame.pose @ registration.transform
        retried = without_dynamic_points(self._features, pose, self._state.key_frames, p, self._sensor)
        if retried.normals is static.normals:
            return registration, static
        return register(reference.features, retried, self._search_parameters, prior), retried


_MIN_EXPECTED_RATIO = 0.5
"""A reference is tried for an unresolved direction if this ratio of `decision.min_information` is expected from it."""
