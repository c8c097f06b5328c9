# SPDX-License-Identifier: Apache-2.0
"""What a scan changes: the only place that writes the state of the track.

=============================== ======================== =========================================
event                           mode after it            by
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

from ..features.records import Features
from ..geometry.se2 import SE2, turned
from ..geometry.symmetric_matrix import inverse
from ..parameters.tree import Parameters
from ..registration.records import Prior, Registration, Status
from ..registration.status import observability_ratio
from .gate import Gate
from .mapping.key_frame_window import Correspondences, KeyFrame, KeyFrameWindow
from .mapping.scan_to_map import align_to_map, alignment_uncertainty, sees_new_surface
from .models.covariance import NO_MEASUREMENT, PoseMeasurement
from .models.manhattan import ManhattanHeading
from .models.motion import ConstantVelocityModel, MotionConstraints
from .models.pose_output import PoseOutput
from .models.stamps import ScanInterval
from .models.wheel_calibration import WheelCalibration
from .prediction import Predictions
from .records import OdometryUpdate
from .references import Match, Outcome
from .state import Mode, Tracking, TrackState


def initial_state(pose: SE2, number: int = 0) -> TrackState:
    """The state before the first scan, which will lie at `pose` and have this `number`."""
    return TrackState(pose, ConstantVelocityModel(pose), PoseOutput(pose, number))


def start(state: TrackState, features: Features, reason: str) -> OdometryUpdate:
    """Start a track at the pose reached so far: the first scan, or one before which tracking was lost for a `reason`."""
    state.motion = ConstantVelocityModel(state.pose)
    state.output.restart(state.pose)
    state.covariance.reset_twist()
    state.heading = ManhattanHeading()
    state.tracking = Tracking()
    if reason:
        state.covariance.add_unknown_motion()
    state.window = KeyFrameWindow((KeyFrame(features, state.pose, number=state.output.number),))
    status = Status.FAILED if reason else Status.OK
    return _report(state, features, Step(state.pose, ScanInterval(reason=reason), status, None, None, True))


def start_in_motion(state: TrackState, first: Features, twist, middle_offset: float) -> None:
    """Replace the `first` scan of a track by the one without the motion within it, now that the `twist` is known."""
    state.window = KeyFrameWindow((KeyFrame(first, state.pose, number=state.window.latest.number),))
    state.motion.start_moving(state.pose, twist, middle_offset)


def reset_velocity(state: TrackState) -> None:
    """Predict no motion, with a twist of which nothing is known."""
    state.motion.reset_velocity()
    state.covariance.reset_twist()


def searched(state: TrackState, outcome: Outcome) -> None:
    """Keep what the next search needs of an `outcome`."""
    state.tracking = dataclasses.replace(state.tracking, unconfirmed=outcome.unconfirmed, search_near=outcome.search_near)


def coast(state: TrackState, features: Features, registration: Registration, predictions: Predictions, p: Parameters) -> OdometryUpdate:
    """The scan is not found: dead reckoning, then standstill or the external prior, then a restart."""
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
        if best is predictions.motion:
            pose = state.pose
    _propagate(state, pose, best.prior, interval)
    state.pose = pose
    state.motion.coast(pose, interval.middle_offset)
    state.tracking = dataclasses.replace(state.tracking, mode=mode, lost_time=lost_time, observability=0.0)
    status = Status.AMBIGUOUS if registration.status is not Status.FAILED else Status.FAILED
    return _report(state, features, Step(pose, interval, status, registration, state.window.latest, False))


def follow(state: TrackState, match: Match, predictions: Predictions, gate: Gate, p: Parameters) -> OdometryUpdate:
    """The scan is found: align it with the map, and update motion, covariances, key frames and heading."""
    before, interval = state.pose, predictions.interval
    if match.verdict.outlier and state.tracking.lost_time:
        # The last pose was only predicted: the difference is a correction, not a motion.
        state.motion.forget_position()
    registration = gate.demoted(match.registration)
    prior = gate.used_prior(match.pose, state.wheels)
    information = gate.prior_information(match.pose, prior)
    aligned = _align(state, match, predictions, information, p)
    covariance = inverse(inverse(aligned.covariance) + information)
    _propagate(state, aligned.pose, prior, interval, PoseMeasurement(np.eye(3) - covariance @ information, aligned.covariance))
    if state.motion.position_unknown:
        state.covariance.reset_twist()
    constraints = MotionConstraints(aligned.direction if aligned.constrained < 1.0 else None,
                                    1.0 if prior.velocity_change is None else aligned.constrained,
                                    registration.rotation_unobservable)
    state.pose = state.motion.update(aligned.pose, interval, constraints, p)
    is_key_frame = _update_key_frames(state, match, aligned, registration, p)
    pose = state.output.averaged(state.pose, covariance, interval.length, p.odometry.zero_velocity_gate)
    update = _report(state, match.features, Step(pose, interval, registration.status, registration, match.key_frame, is_key_frame))
    observability = observability_ratio(registration, p.decision) if registration.status is Status.OK else 0.0
    if predictions.external is not None and gate.supports_external(state.pose):
        _learn(state, predictions.external, before.inverse() @ state.pose, min(state.tracking.observability, observability), p)
    state.tracking = dataclasses.replace(state.tracking, mode=Mode.TRACKING, lost_time=0.0, observability=observability)
    return update


class Aligned(NamedTuple):
    """A scan aligned with the map.

    Attributes
    ----------
    pose : SE2
        In the odometry frame.
    covariance : (3, 3) float
        By the map alone, in the frame of the scan.
    direction : float or None [rad]
        The direction of the translation that the map constrains least, in the odometry frame.
    constrained : float
        From 0 to 1: how well the map constrains that direction, where the match leaves one degenerate; else 1.
    correspondences : Correspondences or None
        With the key frames; None where the odometry has no window.
    """

    pose: SE2
    covariance: np.ndarray
    direction: float | None
    constrained: float
    correspondences: Correspondences | None


def _align(state, match, predictions, information, p) -> Aligned:
    registration, direction = match.registration, match.degenerate_direction
    if p.odometry.reference != 'window':
        return Aligned(match.pose, registration.covariance, direction, _constrained(direction, registration.weakest_information, p), None)
    by_prior = registration.rotation_unobservable and predictions.best is not predictions.motion and information.any()
    pose, correspondences = align_to_map(
        state.window, match.features, match.pose, predictions.best.pose, information, direction, by_prior, p)
    covariance, observed = alignment_uncertainty(
        match.features, pose, correspondences, p, direction is not None, registration.rotation_unobservable)
    return Aligned(pose, covariance, observed.angle, _constrained(direction, observed.weak, p), correspondences)


def _constrained(direction, information, p):
    return 1.0 if direction is None else min(information / p.decision.min_information, 1.0)


def _propagate(state, pose, prior: Prior, interval: ScanInterval, measurement=NO_MEASUREMENT):
    """Propagate heading and covariances to `pose`."""
    step = state.pose.inverse() @ pose
    state.heading.propagate(step)
    state.covariance.propagate(step, interval.length, prior, measurement)
    if interval.gap:
        # Mostly the stamp is wrong and the motion goes on, but its velocity is unknown.
        state.covariance.reset_twist()


def _update_key_frames(state, match, aligned, registration, p) -> bool:
    """Whether the scan becomes a key frame; then the window has it, and the heading follows the walls."""
    due = _is_due(state, match, aligned.pose, registration, p.odometry)
    adds = (not due and match.degenerate_direction is not None and aligned.correspondences is not None
            and sees_new_surface(match.features, aligned.pose, aligned.correspondences, match.degenerate_direction, p))
    observable = aligned.constrained >= _OBSERVABLE and not registration.rotation_unobservable
    here = KeyFrame(match.features, aligned.pose, observable, state.output.number)
    if due or adds:
        size = p.odometry.key_frames if p.odometry.reference == 'window' else 1
        state.window = state.window.with_frame(here, size, latest=due)
    state.tracking = dataclasses.replace(state.tracking, last_scan=None if due or adds else here)
    if (due or adds) and registration.status is Status.OK and p.manhattan.heading_drift:
        _correct_heading(state, match.features, p)
    if due:
        state.covariance.start_key_frame()
    return due or adds


def _is_due(state, match, pose, registration, p):
    """Whether the scan becomes the latest key frame: it has moved, turned, or shares too little with it."""
    moved = match.key_frame.pose.inverse() @ pose
    return (p.reference == 'previous' or match.key_frame is not state.window.latest
            or math.hypot(moved.x, moved.y) > p.key_frame_distance or abs(moved.theta) > p.key_frame_angle
            or registration.overlap < p.key_frame_overlap)


def _correct_heading(state, features, p):
    """Correct the heading by the directions that most walls share."""
    heading = state.output.corrected(state.pose).theta
    rotation, ratio = state.heading.observe(features.segments, heading, p.manhattan)
    state.output.rotate_heading(state.pose, rotation)
    state.covariance.reduce_heading(ratio)


def _learn(state, external, found, weight, p):
    """Learn the systematic error of an `external` prior, now that the motion is `found`."""
    distance = p.prior.calibration_distance
    if distance:
        state.wheels.learn(external, found, weight, distance)
    else:
        state.wheels = WheelCalibration()


class Step(NamedTuple):
    """What is reported of one scan, with poses before the heading correction."""

    pose: SE2
    interval: ScanInterval
    status: Status
    registration: Registration | None
    key_frame: KeyFrame | None
    is_key_frame: bool


def _report(state, features: Features, step: Step) -> OdometryUpdate:
    number, frame = state.output.number, step.key_frame
    pose, increment = state.output.publish(step.pose)
    return OdometryUpdate(
        stamp=features.scan.stamp, pose=pose, covariance=turned(state.covariance.pose, pose.theta) + _LEAST_COVARIANCE,
        twist=state.motion.twist.copy(), twist_covariance=state.covariance.twist + _LEAST_COVARIANCE,
        interval=step.interval.length, increment=increment, status=step.status, registration=step.registration, features=features,
        reference=frame and frame.features, reference_pose=state.output.corrected(frame.pose) if frame else pose,
        reference_changed=step.is_key_frame, restarted=step.interval.reason, wheel_correction=state.wheels.matrix.copy(),
        number=number, reference_number=frame.number if frame else None)


_OBSERVABLE = 0.2
"""Ratio of `decision.min_information` that has to constrain every direction of a key frame for the local map."""
_LEAST_COVARIANCE = np.diag([1e-6, 1e-6, 1e-6])
"""No pose is published as known better than 1 mm, 0.06 deg."""
