# SPDX-License-Identifier: Apache-2.0
"""Update of the track with a scan.

================================================== ======================== ========
event                                              mode after it            function
================================================== ======================== ========
first scan, stamps that go back                    ``STARTING``             `start`
first scan of a further sensor                     ``TRACKING``, as before  `join`
scan found                                         ``TRACKING``             `follow`
scan not found                                     ``COASTING``, ``LOST``   `coast`
the same after a gap, or lost for `restart_time`   ``STARTING``             `coast`
================================================== ======================== ========
"""
import dataclasses
from collections.abc import Mapping

from ..features.records import Features
from ..geometry.array_types import FloatArray
from ..geometry.se2 import SE2
from ..geometry.symmetric_matrix import corrected
from ..mapping.key_frame import KeyFrame
from ..mapping.key_frame_window import KeyFrameWindow, latest_frames
from ..mapping.records import PosePrior
from ..parameters.tree import Parameters
from ..registration.records import Prior, Status
from ..registration.status import observability_ratio
from ..sensor import FIRST, Sensor
from .alignment import Aligned, align_scan
from .gate import Gate
from .key_frame_decision import completes_map, is_due
from .models.manhattan import ManhattanHeading
from .models.motion import ConstantVelocityModel
from .models.stamps import ScanInterval
from .models.wheel_calibration import WheelCalibration
from .prediction import Predictions
from .records import OdometryUpdate
from .references import Match, SearchOutcome
from .report import ReportedStep, report
from .state import LostMap, Mode, Tracking, TrackState
from .verdict import Reason


def start(state: TrackState, features: Features, reason: str, sensor: Sensor = FIRST, time: float = 0.0,
          lost: LostMap | None = None) -> OdometryUpdate:
    """Start a track; the last one ended for a `reason`, after a `time` [s] without found scans and the `lost` map."""
    state.motion = ConstantVelocityModel(state.pose, sensor.name)
    state.output.restart(state.pose)
    state.covariance.reset_twist()
    state.heading = ManhattanHeading()
    state.tracking = Tracking(lost=lost)
    if reason:
        state.covariance.add_unknown_motion(time)
    frame = KeyFrame(features, sensor.pose_at(state.pose), number=state.output.number, sensor=sensor)
    state.window = KeyFrameWindow((frame,))
    status = Status.FAILED if reason else Status.OK
    return report(state, features, ReportedStep(
        pose=state.pose, interval=ScanInterval(0.0, 0.0, 0.0, reason=reason), status=status, is_key_frame=True,
        sensor=sensor))


def join(state: TrackState, features: Features, predictions: Predictions, sensor: Sensor,
         p: Parameters) -> OdometryUpdate:
    """Add the first scan of another `sensor` at its predicted pose, so that an error of its mounting has no effect."""
    best, interval = predictions.best, predictions.interval
    _propagate(state, best.pose, best.prior, interval)
    state.pose = best.pose
    state.motion.join(best.pose, interval.middle_offset, sensor.name)
    frame = KeyFrame(features, sensor.pose_at(best.pose), number=state.output.number, sensor=sensor)
    state.window = state.key_frames.with_frame(frame, p.odometry.window_size)
    return report(state, features, ReportedStep(
        pose=state.pose, interval=interval, status=Status.OK, is_key_frame=True, sensor=sensor, joined=True))


def leave_out(state: TrackState, sensor: Sensor) -> None:
    """Remove the key frames of a `sensor` that is not used."""
    state.window = state.window and state.window.without(sensor.name)


def start_in_motion(state: TrackState, first: Features, twist: FloatArray, interval: ScanInterval) -> None:
    """Replace the first scan of a track by its deskewed features, and set the `twist` [m/s, m/s, rad/s]."""
    frame = dataclasses.replace(state.key_frames.latest, features=first)
    state.window = KeyFrameWindow((frame,))
    state.motion.start_moving(state.pose, twist, interval.middle_offset, frame.sensor.name)
    state.motion.elapse(interval.length)


def replace_key_frames(state: TrackState, found: Mapping[int, tuple[Features, SE2]], sensor: Sensor,
                       middle_offset: float) -> None:
    """Replace features and poses of the key frames of a `sensor` by those `found`, by their numbers; remove others.

    The last one is that of the last scan, whose middle is `middle_offset` [s] after its stamp.
    """
    state.window = state.key_frames.with_features(found, sensor.name)
    state.pose = sensor.first_at(state.window.frames_of(sensor.name)[-1].pose)
    state.motion.start_moving(state.pose, state.motion.twist, middle_offset, sensor.name)


def reset_velocity(state: TrackState) -> None:
    """Reset the velocity to 0, with the covariance of an unknown one."""
    state.motion.reset_velocity()
    state.covariance.reset_twist()


def remember_search(state: TrackState, outcome: SearchOutcome) -> None:
    """Store what the next search needs of an `outcome`."""
    state.tracking = state.tracking._replace(search_near=outcome.search_near)


def coast(state: TrackState, features: Features, outcome: SearchOutcome, gate: Gate, p: Parameters) -> OdometryUpdate:
    """Update with a scan that could not be registered.

    The predicted pose is used for `odometry.coast_time`. After that the velocity is reset, and only external priors
    change the pose. After `odometry.restart_time`, or a gap of more than `time.max_jump`, a new track starts.
    """
    predictions, sensor = gate.predictions, gate.sensor
    predicted, interval = sensor.first_at(predictions.best.pose), predictions.interval
    lost_time = state.tracking.lost_time + max(interval.length, interval.elapsed)
    if lost_time > p.odometry.restart_time or interval.jump:
        pose = state.pose if predictions.by_motion_model else predicted
        lost, state.pose = state.map_before_gap(interval), pose
        return start(state, features, interval.reason or f'lost for {lost_time:.1f} s', sensor, lost_time, lost)
    lost, mode = state.lost_map_after(interval), Mode.COASTING
    if lost_time > p.odometry.coast_time:
        mode = Mode.LOST
        if state.motion.has_velocity:
            reset_velocity(state)
        state.motion.forget_position()
    guess = outcome.guess and sensor.first_at(outcome.guess)
    pose = guess or (state.pose if mode is Mode.LOST and predictions.by_motion_model else predicted)
    _propagate(state, pose, sensor.first_prior(predictions.best.prior), interval)
    state.pose = pose
    frame = KeyFrame(features, sensor.pose_at(pose), number=state.output.number, sensor=sensor)
    last_scans = state.tracking.scans_with(sensor.name, frame)
    state.tracking = state.tracking._replace(
        mode=mode, lost_time=lost_time, observability=0.0, last_scans=last_scans, lost=lost)
    registration = outcome.rejected
    return report(state, features, ReportedStep(
        pose=pose, interval=interval, status=registration.status, registration=registration,
        key_frame=state.key_frames.frames_of(sensor.name)[-1], sensor=sensor))


def follow(state: TrackState, outcome: SearchOutcome, gate: Gate, p: Parameters) -> OdometryUpdate:
    """Update with a registered scan: align it with the map; update motion, covariances, key frames and heading.

    If the scan can be registered only to the previous scan, and that one could not be registered to the map, a chain
    begins: a new map of its own, which is used until a scan is registered to the map before the loss.
    """
    match, interval, tracking = outcome.match, gate.predictions.interval, state.tracking
    if outcome.rejoined is not None:
        _rejoin(state, outcome, p)
        match = outcome.rejoined
    elif tracking.lost_time and match is not None and match.key_frame in tracking.last_scans:
        _begin_chain(state, match.key_frame, interval)
    elif tracking.lost is not None:
        lost = state.lost_map_after(interval)
        kept = lost and lost.window is not state.window and lost.time <= lost.longest(p.odometry)
        state.tracking = tracking._replace(lost=lost if kept else None)
    assert match is not None
    return _FoundScan(state, match, gate, p).update()


def _begin_chain(state: TrackState, first: KeyFrame, interval: ScanInterval) -> None:
    """Begin a new map with the previous scan `first`, which could not be registered to the map before."""
    state.window = KeyFrameWindow((first,))
    state.covariance.start_key_frame()
    pose = first.sensor.first_at(first.pose)
    state.motion.start_moving(pose, state.motion.twist, interval.middle_offset, first.sensor.name)
    state.motion.elapse(interval.length)
    state.tracking = state.tracking._replace(lost_time=0.0, lost=state.lost_map_after(interval), found=pose)


def _rejoin(state: TrackState, outcome: SearchOutcome, p: Parameters) -> None:
    """Return to the map before the loss; the key frames since the loss, if there are any, are moved into that map."""
    lost, found, chained = state.tracking.lost, outcome.rejoined, outcome.match
    assert lost is not None and found is not None
    frames = lost.window.frames
    if chained is None:
        state.motion.forget_position()
    else:
        correction = found.pose @ chained.pose.inverse()
        state.motion.move(correction)
        frames += tuple(dataclasses.replace(frame, pose=correction @ frame.pose) for frame in state.key_frames.frames)
    state.window = KeyFrameWindow(latest_frames(frames, p.odometry.window_size))
    state.pose, state.covariance = lost.pose, lost.covariance
    state.covariance.reset_twist()
    state.tracking = state.tracking._replace(lost_time=0.0, lost=None, found=lost.pose)


def _propagate(state: TrackState, pose: SE2, prior: Prior, interval: ScanInterval,
               gain: FloatArray | None = None, measured: FloatArray | None = None) -> None:
    """Propagate the heading filter and the covariances to `pose`; the others as for `CovariancePropagation`."""
    step = state.pose.inverse() @ pose
    state.heading.propagate(step)
    state.covariance.propagate(step, interval.length, prior, gain, measured)
    if interval.gap:
        # Mostly the stamp is wrong and the motion continues, but its velocity is unknown.
        state.covariance.reset_twist()


class _FoundScan:
    """Update of the track with a registered scan, using the match that the gate accepted."""

    def __init__(self, state: TrackState, match: Match, gate: Gate, p: Parameters):
        self._state, self._match, self._gate, self._parameters, self._sensor = state, match, gate, p, gate.sensor
        lost, chained = state.tracking.lost, None
        if lost and lost.window is not state.window:
            chained = Reason.AFTER_GAP if lost.gap else Reason.SCAN_BEFORE
        self._registration = gate.demoted(match.pose, match.registration, match.verdict, chained)

    def update(self) -> OdometryUpdate:
        """Align the scan with the map, update the state, and report."""
        state, match, gate, registration = self._state, self._match, self._gate, self._registration
        before, interval, sensor = state.pose, gate.predictions.interval, self._sensor
        if gate.is_correction(match.pose, match.verdict) and match.verdict.reason is not Reason.REJOINED:
            state.motion.forget_position()
        # Align with the map, with the prior where the match does not contradict it.
        prior = gate.used_prior(match.pose, state.wheels)
        map_prior = PosePrior(gate.predictions.best.pose, gate.prior_information(match.pose, prior))
        aligned = align_scan(state.key_frames, match, map_prior, gate.predictions, self._parameters)
        added = match.mixture_covariance(gate.predictions.best)
        # Update covariances, motion and key frames.
        information = map_prior.information if map_prior.information.any() else gate.motion_information(prior)
        covariance, gain = corrected(aligned.covariance, information)
        pose = sensor.first_at(aligned.pose)
        _propagate(state, pose, sensor.first_prior(prior), interval, sensor.first_gain(gain),
                   sensor.first_covariance(aligned.covariance + added))
        if state.motion.position_unknown:
            state.covariance.reset_twist()
        constraints = aligned.motion_constraints(prior, registration)
        state.pose = state.motion.update(pose, interval, constraints, self._parameters, sensor.name)
        state.sensors[sensor.name].stamps.compare_velocities(state.motion.moved(state.pose, interval.middle_offset))
        if registration.status is Status.OK:
            state.covariance.observe(state.motion.twist)
        is_key_frame = self._update_key_frames(aligned)
        # Report, and calibrate the wheels by the motion.
        pose = state.output.averaged(state.pose, sensor.first_covariance(covariance + added), interval.length,
                                     self._parameters.odometry.zero_velocity_gate)
        update = report(state, match.features, ReportedStep(
            pose=pose, interval=interval, status=registration.status, registration=registration,
            key_frame=match.key_frame, is_key_frame=is_key_frame, sensor=sensor,
            contradicted=gate.predictions.contradicted))
        ok = registration.status is Status.OK
        observability = observability_ratio(registration, self._parameters.decision) if ok else 0.0
        self._calibrate_wheels(before.inverse() @ state.pose, observability)
        state.tracking = state.tracking._replace(mode=Mode.TRACKING, lost_time=0.0, observability=observability,
                                                 score=match.registration.score, found=state.pose)
        return update

    def _update_key_frames(self, aligned: Aligned) -> bool:
        """Add the scan to the key frames if it is due or sees new surfaces, and then correct the heading.

        Returns
        -------
        bool
            Whether the scan became a key frame. It becomes the latest key frame only if it is due.
        """
        state, match, p = self._state, self._match, self._parameters
        registration, direction = self._registration, match.degenerate_direction
        due = is_due(match, aligned, registration.overlap, state.key_frames, self._sensor.name, p)
        added = due or completes_map(match, aligned, p)
        constrained = aligned.constrained >= _MIN_CONSTRAINED and not registration.rotation_unobservable
        frame = KeyFrame(match.features, aligned.pose, constrained, state.output.number, self._sensor)
        if added:
            state.window = state.key_frames.with_frame(frame, p.odometry.window_size, latest=due)
        last_scans = state.tracking.scans_with(self._sensor.name, None if added else frame)
        state.tracking = state.tracking._replace(last_scans=last_scans)
        if added and registration.status is Status.OK and p.manhattan.heading_drift:
            self._correct_heading()
        if due:
            state.covariance.start_key_frame()
        elif added and direction is not None:
            # Only this frame constrains the direction in which it completes the map, with the error of its pose.
            state.covariance.start_key_frame(direction - state.pose.theta)
        return added

    def _correct_heading(self) -> None:
        """Apply the Manhattan heading correction to the published poses."""
        state = self._state
        heading = self._sensor.pose_at(state.output.corrected(state.pose)).theta
        rotation, ratio = state.heading.observe(self._match.features.segments, heading, self._parameters.manhattan)
        state.output.rotate_heading(state.pose, rotation)
        state.covariance.reduce_heading(ratio)

    def _calibrate_wheels(self, motion: SE2, observability: float) -> None:
        """Estimate the systematic errors of the external prior from the `motion`, as far as the scans constrain it."""
        state, predictions, sensor = self._state, self._gate.predictions, self._sensor
        external = predictions.external or predictions.contradicted
        distance = self._parameters.prior.calibration_distance
        if external is not None and not distance:
            state.wheels = WheelCalibration()
        elif external is not None and not predictions.interval.gap:
            state.wheels.learn(sensor.first_prior(external), motion, min(state.tracking.observability, observability),
                               distance, self._gate.supports_external(sensor.pose_at(state.pose)))


_MIN_CONSTRAINED = 0.2
"""The local map contains only points of key frames whose `Aligned.constrained` is at least this."""
