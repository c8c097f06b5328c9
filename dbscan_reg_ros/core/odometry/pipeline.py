# SPDX-License-Identifier: Apache-2.0
"""Laser odometry: estimates the pose of a moving sensor from its scans."""
import copy
import dataclasses
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..errors import ScanError
from ..features.extraction import extract_from_returns
from ..features.records import Features
from ..features.returns import Returns
from ..geometry.se2 import SE2
from ..parameters.features import ScanParameters
from ..parameters.tree import Parameters, expect_parameters
from ..registration.records import Prior, Status
from ..scan import Scan
from ..sensor import FIRST, Sensor
from . import update
from .calibration.comparisons import LidarComparisons
from .calibration.location import Location, locate
from .gate import Gate
from .models.beam_timing import MovingScan
from .models.repeated_scans import RepeatedScans
from .models.stamps import Jump, ScanInterval, middle_offset
from .prediction import Predictions, predict
from .records import OdometryUpdate
from .reference_search import ReferenceSearch
from .references import SearchOutcome, search_parameters
from .report import report_waiting
from .state import Mode, SensorState, TrackState


class Odometry:
    """Estimates the poses of a moving sensor, scan by scan.

    Parameters
    ----------
    parameters : Parameters
        All parameters. They can be replaced at any time; new values apply from the next scan on, and existing key
        frames are not changed.
    comparisons : LidarComparisons, optional
        Comparison of further lidars with the first one; decides whether they are used.

    Attributes
    ----------
    comparisons : LidarComparisons
    """

    def __init__(self, parameters: Parameters = Parameters(),
                 comparisons: LidarComparisons | None = None):
        self.parameters = parameters
        self.comparisons = comparisons or LidarComparisons()
        self._state, self._repeated = TrackState.initial(SE2(), number=0), RepeatedScans()

    @property
    def parameters(self) -> Parameters:
        """The parameters that apply from the next scan on."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: Parameters) -> None:
        expect_parameters(parameters)
        self._parameters, self._search_parameters = parameters, search_parameters(parameters)
        self._limited: dict[ScanParameters, Parameters] = {}

    def reset(self, pose: SE2 = SE2()) -> None:
        """Forget all but the number of scans and the timing of beams; the next scan starts a track at `pose`."""
        self._state = TrackState.initial(pose, self._state.output.number, self._state.sensors)
        self._repeated = RepeatedScans()
        self.comparisons.restart()

    def process(self, scan: Scan, prior: Prior | None = None, sensor: Sensor = FIRST) -> OdometryUpdate:
        """Register a scan and estimate the pose of the first sensor.

        Parameters
        ----------
        scan : Scan
        prior : Prior, optional
            Motion of the first sensor since the last scan of any sensor, from an external source (wheels, gyroscope).
            If it measures translation and rotation, its systematic errors are estimated online
            (`prior.calibration_distance`). Without a prior the motion model predicts, unless `prior.source` is
            ``none``.
        sensor : Sensor
            The sensor of the scan. Scans of several sensors should be processed in the order of their stamps. A track
            begins with the sensor of its first scan; other sensors are added as soon as the velocity is known.

        Returns
        -------
        OdometryUpdate

        Raises
        ------
        ScanError
            When the scan has too few returns, is too old compared with the last scan of another sensor, or repeats the
            scan before although the robot moves. The track is not changed then.
        """
        result = self._process(scan, prior, sensor)
        if not result.waits:
            motion = result.increment if result.status is Status.OK else None
            self._repeated.used(sensor.name, motion, prior)
        if self.comparisons.lidars and not result.repeats:
            self.comparisons.add(result, self.locate)
        return result

    def locate(self, result: OdometryUpdate, guess: bool = True) -> Location | None:
        """Locate the latest scan, of a further sensor, in the map of the sensors of rank 0; no effect on the track.

        Its mounting may be wrong by about 0.3 m and 10 deg; without `guess` it is not used.
        """
        state, window = self._state, self._state.window and self._state.window.of_rank(0)
        if not window:
            return None
        elapsed = state.order.time_since_last(result.stamp)
        predicted = result.sensor.pose_at(state.motion.moved(state.pose, elapsed)) if guess else None
        location = locate(result.features, window, predicted, self._parameters, self._search_parameters)
        return location and location._replace(pose=state.output.corrected(location.pose))

    def _process(self, scan: Scan, prior: Prior | None, sensor: Sensor) -> OdometryUpdate:
        """Register a scan; the steps of `process`."""
        state, p = self._state, self._parameters
        # Stamp: when the beams were measured, how long the scan took, and whether its motion can be removed.
        uses = self._uses(scan, sensor)
        own = self._sensor_state(scan, sensor, uses)
        sent = own.no_return.removed_from(scan)
        scan = own.timing.measured(sent, self._with_limits(sensor.limits).scan)
        timing = own.stamps.timing(scan, p, state.order.time_since_last(scan.stamp))
        # Features of the deskewed scan.
        twist = timing.ratio * sensor.twist_of(state.motion.twist) if timing.deskews else None
        features = self._extract(scan, twist, sensor)
        repeats = self._repeated.add(sensor.name, scan, prior, p.odometry.coast_time)
        since_own = own.stamps.next(scan.stamp, timing.middle_offset(scan, features), p.time, timing.duration)
        if not uses or repeats or self._waits(scan, sensor):
            return report_waiting(state, features, sensor, repeats)
        interval = self._since_last(scan, sensor, since_own)
        if state.window is None or interval.jump is Jump.BACKWARD:
            return self._learn_timing(update.start(state, features, interval.reason, sensor), sent)
        # Predict by the external prior and by the motion model.
        state.motion.elapse(interval.length)
        predictions = predict(state, prior, interval, p)
        if interval.jump:
            update.reset_velocity(state)
        if self._joins(predictions, sensor, since_own):
            return update.join(state, features, predictions, sensor, p)
        gate = Gate(predictions, state.tracking, p, sensor)
        # Register to the local map, else to other references; the gate decides which result is believed.
        gate, outcome = self._search(features, gate)
        if timing.deskews and self._starts_in_motion(outcome, gate):
            own.timing.restart_track()
            features, gate = self._start_in_motion(scan, outcome, gate)
            gate, outcome = self._search(features, gate)
        # Not found: dead reckoning, or a restart.
        if outcome.match is None and outcome.rejoined is None:
            return update.coast(state, features, outcome, gate, p)
        # Found: align with the map; update motion, covariances, key frames and heading; report.
        result = update.follow(state, outcome, gate, p)
        assert result.registration is not None
        own.agreement = own.agreement.after(result.registration.agreement)
        return self._learn_timing(result, sent)

    def predict_motion(self, stamp: int) -> Prior | None:
        """Predict the motion to a scan at `stamp` [ns] with the motion model alone; None before the first scan."""
        state, p = self._state, self._parameters
        if state.window is None:
            return None
        own = state.sensors[state.key_frames.latest.sensor.name]
        interval = copy.deepcopy(own.stamps).next(stamp, 0.0, p.time, own.stamps.duration)
        if len(state.sensors) > 1:
            elapsed = state.order.time_since_last(stamp)
            interval = interval._replace(length=elapsed, elapsed=elapsed, of_others=True)
        return state.motion.predict(interval, p)

    def _sensor_state(self, scan: Scan, sensor: Sensor, uses: bool) -> SensorState:
        """Return the state stored for a sensor, a new one for a new sensor.

        Raises
        ------
        ScanError
            When a scan that is used is too old.
        """
        late = self._state.order.lateness(sensor.name, scan.stamp, self._parameters.time)
        if late and uses:
            raise ScanError(f'the scan at {scan.stamp} ns is {late:.3f} s older than the last one of another sensor; '
                            'expected scans in the order of their stamps')
        if sensor.name not in self._state.sensors:
            self._state.sensors[sensor.name] = SensorState()
        return self._state.sensors[sensor.name]

    def _uses(self, scan: Scan, sensor: Sensor) -> bool:
        """Whether a scan may change the track; key frames of a sensor that may not are removed."""
        if not (sensor.rank or self.comparisons.lidars):
            return True
        state = self._state
        first_maps = (state.window is not None and bool(state.window.of_rank(0))
                      and state.order.time_since_last(scan.stamp) <= self._parameters.odometry.coast_time)
        uses = self.comparisons.uses(sensor, scan.stamp, first_maps)
        if not uses:
            update.leave_out(state, sensor)
        return uses

    def _waits(self, scan: Scan, sensor: Sensor) -> bool:
        """Whether a scan of another sensor cannot be added yet, because the velocity is still unknown."""
        state = self._state
        if state.window is None or sensor.name in state.window.sensors or state.tracking.mode is not Mode.STARTING:
            return False
        return state.order.time_since_last(scan.stamp) <= self._parameters.odometry.coast_time

    def _since_last(self, scan: Scan, sensor: Sensor, own: ScanInterval) -> ScanInterval:
        """Add a scan to the order of all, and return the interval since the last; `own` is that of the `sensor` alone.

        After a gap of the `sensor` its last pose is forgotten, after stamps that went back the state of all others.
        """
        state, p = self._state, self._parameters
        stamps = state.sensors[sensor.name].stamps
        interval = state.order.since_last(sensor.name, scan.stamp, own, stamps, p.time)
        if interval.of_others and own.gap:
            state.motion.forget_sensor(sensor.name)
        if interval.jump is Jump.BACKWARD:
            state.sensors = {sensor.name: state.sensors[sensor.name]}
        return interval

    def _joins(self, predictions: Predictions, sensor: Sensor, since_own: ScanInterval) -> bool:
        """Whether to add a sensor to the track: it has no key frame or was silent, and its pose is predicted well.

        After a silence of more than `time.max_jump`, its own key frames may be out of its sight. If the rotation is
        predicted poorly, it is searched for in them nevertheless.
        """
        state, prior, margin = self._state, predictions.best.prior, self._parameters.odometry.dynamic_margin
        returns = (since_own.jump is not None and predictions.interval.jump is None
                   and prior.rotation_sigma < margin)
        return ((returns or sensor.name not in state.key_frames.sensors) and state.tracking.mode is Mode.TRACKING
                and prior.translation_sigma < margin)

    def _extract(self, scan: Scan, twist: NDArray[np.float64] | None, sensor: Sensor,
                 again: bool = False) -> Features:
        """Extract the features of a scan.

        Parameters
        ----------
        scan : Scan
        twist : (3,) float or None
            Velocity of the sensor [m/s, m/s, rad/s] with which the scan is deskewed; None: not deskewed.
        sensor : Sensor
            The sensor of the scan, for which a state is stored.
        again : bool
            Whether features of this scan were extracted before: it is then left out of the range noise estimate.
        """
        p, own = self._with_limits(sensor.limits), self._state.sensors[sensor.name]
        returns = Returns(scan, p.scan, twist)
        noise = own.noise if again else own.noise.after(returns.noise_ratio)
        features = extract_from_returns(returns, p, noise.value, p.odometry.pole_size)
        own.noise = noise
        return features.with_scattered_surfaces() if own.agreement.is_chance else features

    def _learn_timing(self, result: OdometryUpdate, sent: Scan) -> OdometryUpdate:
        """Learn from a key frame, a scan as `sent`, when its beams are measured; report and apply what was found."""
        state, sensor, p = self._state, result.sensor, self._with_limits(result.sensor.limits)
        search, stamps = state.sensors[sensor.name].timing, state.sensors[sensor.name].stamps
        if result.starts_track:
            search.restart_track()
        if search.found or result.status is not Status.OK or not (result.is_key_frame and p.odometry.deskew):
            return result
        ratio = stamps.ratio(stamps.duration)
        twist = ratio * sensor.twist_of(state.motion.twist)
        moving = MovingScan.of(result, sent, search.measured(sent, p.scan), twist, sensor.pose_at(state.pose))
        finding = search.add(moving, stamps.typical, partial(self._extract, sensor=sensor, again=True), p)
        if finding:
            update.replace_key_frames(state, search.key_frames(), sensor, ratio * search.middle_offset)
        return dataclasses.replace(result, finding=finding)

    def _with_limits(self, limits: ScanParameters | None) -> Parameters:
        """Return the parameters with the `limits` of a sensor; None: as they are."""
        if limits is None or limits == self._parameters.scan:
            return self._parameters
        if limits not in self._limited:
            self._limited[limits] = dataclasses.replace(self._parameters, scan=limits)
        return self._limited[limits]

    def _search(self, features: Features, gate: Gate) -> tuple[Gate, SearchOutcome]:
        """Register the scan to the local map and, if needed, to other references; where wheels slip, without them."""
        for used in filter(None, (gate.without_wheels(), gate)):
            outcome = ReferenceSearch(features, self._state, used, self._parameters, self._search_parameters).run()
            if outcome.is_certain:
                break
        update.remember_search(self._state, outcome)
        return used, outcome

    def _starts_in_motion(self, outcome: SearchOutcome, gate: Gate) -> bool:
        """Whether the second scan of a track proves that the sensor moved during the first."""
        state, match = self._state, outcome.match
        return (state.tracking.mode is Mode.STARTING and match is not None
                and gate.starts_in_motion(match.pose, match.registration, gate.sensor.pose_at(state.pose)))

    def _start_in_motion(self, scan: Scan, outcome: SearchOutcome, gate: Gate) -> tuple[Features, Gate]:
        """Deskew the first two scans of a track with their motion; return features and gate of the second scan."""
        state, predictions, sensor = self._state, gate.predictions, gate.sensor
        assert outcome.match is not None
        own = state.sensors[sensor.name]
        ratio = own.stamps.ratio(own.stamps.duration)
        twist = (sensor.pose_at(state.pose).inverse() @ outcome.match.pose).as_array() / predictions.interval.length
        first = self._extract(state.key_frames.latest.features.measured, ratio * twist, sensor, again=True)
        features = self._extract(scan, ratio * twist, sensor, again=True)
        interval = predictions.interval._replace(middle_offset=middle_offset(scan, features, ratio))
        update.start_in_motion(state, first, sensor.first_twist(twist), interval)
        return features, gate.after(interval)
