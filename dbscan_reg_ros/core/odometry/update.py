# SPDX-License-Identifier: Apache-2.0
"""Update of the track by a scan.

=============================== ======================== =========================================
event                           mode after it            function
=============================== ======================== =========================================
first scan, jump of the stamps  ``STARTING``             `start`
scan found                      ``TRACKING``             `follow`
scan not found                  ``COASTING``, ``LOST``   `coast`
lost for `restart_time`         ``STARTING``             `coast`
=============================== ======================== =========================================
"""
import dataclasses
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..features.records import Features
from ..geometry.se2 import DOF, SE2
from ..geometry.symmetric_matrix import inverse
from ..parameters.tree import Parameters
from ..registration.records import Prior, Registration, Status
from ..registration.status import observability_ratio
from .gate import LIMITS, Gate
from .mapping.correspondences import Correspondences, PosePrior
from .mapping.key_frame import KeyFrame
from .mapping.key_frame_window import KeyFrameWindow
from .mapping.scan_to_map import InitialAlignment, align_to_map, alignment_uncertainty, sees_new_surface
from .models.covariance import NO_MEASUREMENT, PoseMeasurement
from .models.manhattan import ManhattanHeading
from .models.motion import ConstantVelocityModel, MotionConstraints
from .models.pose_output import PoseOutput
from .models.stamps import ScanInterval
from .models.wheel_calibration import WheelCalibration
from .prediction import Predictions
from .records import OdometryUpdate
from .references import Match, Outcome
from .report import ReportedStep, report
from .state import Mode, Tracking, TrackState


def initial_state(pose: SE2, number: int) -> TrackState:
    """Create the state before the first scan, which will be at `pose` and have this `number`."""
    return TrackState(pose, ConstantVelocityModel(pose), PoseOutput(pose, number))


def start(state: TrackState, features: Features, reason: str) -> OdometryUpdate:
    """Start a track at the last pose, with a `reason` where another one ended."""
    state.motion = ConstantVelocityModel(state.pose)
    state.output.restart(state.pose)
    state.covariance.reset_twist()
    state.heading = ManhattanHeading()
    state.tracking = Tracking()
    if reason:
        state.covariance.add_unknown_motion()
    state.window = KeyFrameWindow((KeyFrame(features, state.pose, number=state.output.number),))
    status = Status.FAILED if reason else Status.OK
    return report(state, features, ReportedStep(
        pose=state.pose, interval=ScanInterval(0.0, 0.0, 0.0, reason=reason), status=status, is_key_frame=True))


def start_in_motion(state: TrackState, first: Features, twist: NDArray[np.float64], interval: ScanInterval) -> None:
    """Replace the first scan of a track by its deskewed features; set the `twist` [m/s, m/s, rad/s] since then."""
    state.window = KeyFrameWindow((KeyFrame(first, state.pose, number=state.key_frames.latest.number),))
    state.motion.start_moving(state.pose, twist, interval.middle_offset)
    state.motion.elapse(interval.length)


def reset_velocity(state: TrackState) -> None:
    """Reset the velocity to 0, with the covariance of an unknown one."""
    state.motion.reset_velocity()
    state.covariance.reset_twist()


def remember_search(state: TrackState, outcome: Outcome) -> None:
    """Store what the next search needs of an `outcome`."""
    state.tracking = dataclasses.replace(
        state.tracking, unconfirmed=outcome.unconfirmed, search_near=outcome.search_near)


def coast(state: TrackState, features: Features, outcome: Outcome, predictions: Predictions,
          p: Parameters) -> OdometryUpdate:
    """Update by a scan that was not found.

    The prediction is followed for `odometry.coast_time`. After that the velocity is reset, and only external priors
    move the pose. After `odometry.restart_time`, or a jump of the stamps, a new track starts.
    """
    best, interval = predictions.best, predictions.interval
    lost_time = state.tracking.lost_time + max(interval.length, interval.elapsed)
    if lost_time > p.odometry.restart_time or interval.jump:
        if predictions.external is not None:
            state.pose = best.pose
        return start(state, features, interval.reason or f'lost for {lost_time:.1f} s')
    pose, mode = best.pose, Mode.COASTING
    if lost_time > p.odometry.coast_time:
        mode = Mode.LOST
        if state.motion.has_velocity:
            reset_velocity(state)
        state.motion.forget_position()
        if predictions.by_motion_model:
            pose = state.pose
    _propagate(state, pose, best.prior, interval)
    state.pose = pose
    state.tracking = dataclasses.replace(state.tracking, mode=mode, lost_time=lost_time, observability=0.0)
    registration = _rejected(outcome)
    return report(state, features, ReportedStep(
        pose=pose, interval=interval, status=registration.status, registration=registration,
        key_frame=state.key_frames.latest))


def _rejected(outcome: Outcome) -> Registration:
    """Return the registration to the local map, with the reason for which the gate rejected a result."""
    registration, rejection = outcome.registration, outcome.rejection
    if rejection is None:
        return registration
    failed = registration.status is Status.FAILED or rejection in LIMITS
    return dataclasses.replace(registration, status=Status.FAILED if failed else Status.AMBIGUOUS,
                               reason='; '.join(filter(None, (registration.reason, rejection.value))))


def follow(state: TrackState, match: Match, gate: Gate, p: Parameters) -> OdometryUpdate:
    """Update by a scan that was found: align it with the map; update motion, covariances, key frames and heading."""
    return _FoundScan(state, match, gate, p).update()


class _Aligned(NamedTuple):
    """A scan aligned with the map.

    Attributes
    ----------
    pose : SE2
        Pose of the scan in the odometry frame.
    covariance : (3, 3) float
        Covariance by the map alone, in the frame of the scan [m, m, rad].
    direction : float or None [rad]
        Direction of the translation that the map constrains least, in the odometry frame.
    constrained : float
        From 0 to 1: how well the map constrains a direction that is degenerate for the match; else 1.
    correspondences : Correspondences or None
        Correspondences with the key frames; None without a window.
    """

    pose: SE2
    covariance: NDArray[np.float64]
    direction: float | None
    constrained: float
    correspondences: Correspondences | None


def _constrained(direction: float | None, information: float | None, p: Parameters) -> float:
    """Return how well a degenerate `direction` is constrained, from 0 to 1, by its `information` [points]."""
    return 1.0 if direction is None or information is None else min(information / p.decision.min_information, 1.0)


def _motion_constraints(aligned: _Aligned, prior: Prior, registration: Registration) -> MotionConstraints:
    """Return the constraints for the motion model; an external prior observes the velocity in every direction."""
    return MotionConstraints(aligned.direction if aligned.constrained < 1.0 else None,
                             1.0 if prior.velocity_change is None else aligned.constrained,
                             registration.rotation_unobservable)


def _propagate(state: TrackState, pose: SE2, prior: Prior, interval: ScanInterval,
               measurement: PoseMeasurement = NO_MEASUREMENT) -> None:
    """Propagate heading and covariances to `pose`."""
    step = state.pose.inverse() @ pose
    state.heading.propagate(step)
    state.covariance.propagate(step, interval.length, prior, measurement)
    if interval.gap:
        # Mostly the stamp is wrong and the motion continues, but its velocity is unknown.
        state.covariance.reset_twist()


class _FoundScan:
    """Update of the track by a scan that was found: by the match that the gate believes."""

    def __init__(self, state: TrackState, match: Match, gate: Gate, p: Parameters):
        self._state, self._match, self._gate, self._parameters = state, match, gate, p
        self._registration = gate.demoted(match.registration)

    def update(self) -> OdometryUpdate:
        """Align the scan with the map, update the state, and report."""
        state, match, gate, registration = self._state, self._match, self._gate, self._registration
        before, interval = state.pose, gate.predictions.interval
        if match.verdict.outlier and state.tracking.lost_time:
            # The difference from the predictions is a correction, not a motion.
            state.motion.forget_position()
        # Align with the map, with the prior where the match does not contradict it.
        prior = gate.used_prior(match.pose, state.wheels)
        map_prior = PosePrior(gate.predictions.best.pose, gate.prior_information(match.pose, prior))
        aligned = self._align(map_prior)
        # Update covariances, motion and key frames.
        information = map_prior.information if map_prior.information.any() else gate.motion_information(prior)
        covariance = inverse(inverse(aligned.covariance) + information)
        gain = np.eye(DOF) - covariance @ information
        _propagate(state, aligned.pose, prior, interval, PoseMeasurement(gain, aligned.covariance))
        if state.motion.position_unknown:
            state.covariance.reset_twist()
        constraints = _motion_constraints(aligned, prior, registration)
        state.pose = state.motion.update(aligned.pose, interval, constraints, self._parameters)
        is_key_frame = self._update_key_frames(aligned)
        # Report, and learn from the motion.
        zero_velocity_gate = self._parameters.odometry.zero_velocity_gate
        pose = state.output.averaged(state.pose, covariance, interval.length, zero_velocity_gate)
        update = report(state, match.features, ReportedStep(
            pose=pose, interval=interval, status=registration.status, registration=registration,
            key_frame=match.key_frame, is_key_frame=is_key_frame))
        self._learn(before.inverse() @ state.pose)
        return update

    def _align(self, prior: PosePrior) -> _Aligned:
        """Align the scan with the key frames of the window; without a window the match is the result."""
        match, registration, p = self._match, self._match.registration, self._parameters
        direction = match.degenerate_direction
        if p.odometry.reference != 'window':
            constrained = _constrained(direction, registration.weakest_information, p)
            return _Aligned(match.pose, registration.covariance, direction, constrained, None)
        initial = InitialAlignment(match.pose, direction, registration.rotation_unobservable)
        # An unobservable rotation is left to an external prior; the motion model knows it no better than the match.
        rotation_by_prior = (registration.rotation_unobservable and not self._gate.predictions.by_motion_model
                             and bool(prior.information.any()))
        pose, correspondences = align_to_map(
            self._state.key_frames, match.features, initial._replace(rotation_unobservable=rotation_by_prior), prior, p)
        covariance, observed = alignment_uncertainty(match.features, pose, correspondences, initial, p)
        return _Aligned(pose, covariance, observed.angle, _constrained(direction, observed.weak, p), correspondences)

    def _update_key_frames(self, aligned: _Aligned) -> bool:
        """Add the scan to the key frames if it is due or sees new surfaces, and then correct the heading.

        Returns
        -------
        bool
            Whether the scan became a key frame. Only one that is due becomes the latest.
        """
        state, match, p = self._state, self._match, self._parameters
        due = self._is_due(aligned.pose)
        added = due or self._completes_map(aligned)
        constrained = aligned.constrained >= _MIN_CONSTRAINED and not self._registration.rotation_unobservable
        frame = KeyFrame(match.features, aligned.pose, constrained, state.output.number)
        if added:
            size = p.odometry.key_frames if p.odometry.reference == 'window' else 1
            state.window = state.key_frames.with_frame(frame, size, latest=due)
        state.tracking = dataclasses.replace(state.tracking, last_scan=None if added else frame)
        if added and self._registration.status is Status.OK and p.manhattan.heading_drift:
            self._correct_heading()
        if due:
            state.covariance.start_key_frame()
        return added

    def _completes_map(self, aligned: _Aligned) -> bool:
        """Whether the scan sees surfaces that would constrain a degenerate direction and that no key frame has."""
        direction, correspondences = self._match.degenerate_direction, aligned.correspondences
        if direction is None or correspondences is None:
            return False
        return sees_new_surface(self._match.features, aligned.pose, correspondences, direction, self._parameters)

    def _is_due(self, pose: SE2) -> bool:
        """Whether the scan becomes the latest key frame: it has moved, rotated, or overlaps too little with it."""
        p, frame = self._parameters.odometry, self._match.key_frame
        motion = frame.pose.inverse() @ pose
        return (p.reference == 'previous' or frame is not self._state.key_frames.latest
                or math.hypot(motion.x, motion.y) > p.key_frame_distance or abs(motion.theta) > p.key_frame_angle
                or self._registration.overlap < p.key_frame_overlap)

    def _correct_heading(self) -> None:
        """Apply the Manhattan heading correction to the published poses."""
        state = self._state
        heading = state.output.corrected(state.pose).theta
        rotation, ratio = state.heading.observe(self._match.features.segments, heading, self._parameters.manhattan)
        state.output.rotate_heading(state.pose, rotation)
        state.covariance.reduce_heading(ratio)

    def _learn(self, motion: SE2) -> None:
        """Learn the systematic errors of the external prior from the observed `motion`, and track from now on."""
        state, external = self._state, self._gate.predictions.external
        distance = self._parameters.prior.calibration_distance
        ok = self._registration.status is Status.OK
        observability = observability_ratio(self._registration, self._parameters.decision) if ok else 0.0
        if external is not None and self._gate.supports_external(state.pose):
            if distance:
                state.wheels.learn(external, motion, min(state.tracking.observability, observability), distance)
            else:
                state.wheels = WheelCalibration()
        state.tracking = dataclasses.replace(
            state.tracking, mode=Mode.TRACKING, lost_time=0.0, observability=observability,
            score=self._match.registration.score, found=state.pose)


_MIN_CONSTRAINED = 0.2
"""Least `_Aligned.constrained` of a key frame from which the local map takes points."""
