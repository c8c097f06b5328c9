# SPDX-License-Identifier: Apache-2.0
"""Laser odometry: from scans to poses."""
import copy
import dataclasses

from ..features.extraction import extract_features, scan_noise_ratio
from ..features.records import Features
from ..features.small_objects import with_poles
from ..geometry.se2 import SE2
from ..parameters.tree import Parameters
from ..registration.pipeline import load_strategies
from ..registration.records import Prior
from ..scan import Scan
from . import update
from .deskew import deskew
from .gate import Gate
from .models.stamps import Jump, middle_offset
from .prediction import Predictions, predict
from .records import OdometryUpdate
from .references import Outcome, ReferenceSearch
from .state import Mode


class Odometry:
    """Poses of a moving sensor from a stream of its scans.

    Parameters
    ----------
    parameters : Parameters
        May be replaced at any time; a new value counts from the next scan on, and key frames stay as they are.
    """

    def __init__(self, parameters: Parameters = Parameters()):
        self.parameters = parameters
        self._state = update.initial_state(SE2())

    @property
    def parameters(self) -> Parameters:
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: Parameters) -> None:
        load_strategies(parameters)
        self._parameters, self._search_parameters = parameters, search_parameters(parameters)

    def reset(self, pose: SE2 = SE2()) -> None:
        """Forget everything; the next scan is the first one, at `pose`."""
        self._state = update.initial_state(pose, self._state.output.number)

    def process(self, scan: Scan, prior: Prior | None = None) -> OdometryUpdate:
        """Register a scan and estimate the pose of the sensor.

        Parameters
        ----------
        scan : Scan
        prior : Prior, optional
            Motion of the sensor since the last scan from an external source (wheels, gyroscope). Systematic errors of whole
            motions are learned (`prior.calibration_distance`). Without a prior the motion model predicts, unless
            `odometry.prior` says otherwise.

        Returns
        -------
        OdometryUpdate

        Raises
        ------
        ScanError
            When the scan holds too few returns to be used; the state is unchanged.
        """
        state, p = self._state, self._parameters
        # Stamp: how long the scan took, and whether its motion can be removed.
        timing = state.stamps.timing(scan, p)
        # Features, of the scan without the motion within it.
        features = self._extract(scan, timing.ratio * state.motion.twist if timing.deskews else None)
        interval = state.stamps.next(scan.stamp, timing.middle_offset(scan, features), p.time, timing.duration)
        if state.window is None or interval.jump is Jump.BACKWARD:
            return update.start(state, features, interval.reason)
        # Predict: by the external prior and by the motion model.
        if interval.jump:
            update.reset_velocity(state)
        state.motion.elapse(interval.length)
        predictions = predict(state, prior, interval, p)
        # Register to the local map, else to other references; the gate decides what is believed.
        outcome = self._search(features, predictions)
        if timing.deskews and self._starts_in_motion(outcome, predictions):
            features, predictions = self._start_in_motion(scan, outcome, predictions)
            outcome = self._search(features, predictions)
        # Not found: dead reckoning, or a restart.
        if outcome.match is None:
            return update.coast(state, features, outcome.registration, predictions, p)
        # Found: align with the map, update motion, covariances, key frames and heading, and report.
        return update.follow(state, outcome.match, predictions, Gate(predictions, state.tracking, p), p)

    def predict_motion(self, stamp: int) -> Prior | None:
        """The motion to a scan at `stamp` [ns] by the motion model alone; None before the first scan."""
        state, p = self._state, self._parameters
        if state.window is None:
            return None
        return state.motion.predict(copy.deepcopy(state.stamps).next(stamp, 0.0, p.time, state.stamps.duration), p)

    def _extract(self, scan: Scan, twist, again: bool = False) -> Features:
        """Features of a scan; a `twist` [m/s, m/s, rad/s] is removed from it. A scan seen `again` adds nothing to the noise ratio."""
        state, p = self._state, self._parameters
        if twist is not None:
            scan = deskew(scan, twist)
        noise = state.noise if again else state.noise.after(scan_noise_ratio(scan, p.scan))
        features = extract_features(scan, p, noise.value)
        state.noise = noise
        return with_poles(features, p.odometry.pole_size, p.segments) if p.odometry.pole_size else features

    def _search(self, features: Features, predictions: Predictions) -> Outcome:
        outcome = ReferenceSearch(features, self._state, predictions, self._parameters, self._search_parameters).run()
        update.searched(self._state, outcome)
        return outcome

    def _starts_in_motion(self, outcome: Outcome, predictions: Predictions) -> bool:
        """Whether the second scan of a track proves that the sensor moved during the first."""
        state = self._state
        return (state.tracking.mode is Mode.STARTING and outcome.match is not None and Gate(predictions, state.tracking, self._parameters)
                .starts_in_motion(outcome.match.pose, outcome.registration, state.pose))

    def _start_in_motion(self, scan: Scan, outcome: Outcome, predictions: Predictions) -> tuple[Features, Predictions]:
        """Remove the motion from the first scan of a track and from the second, now that it is known."""
        state, interval = self._state, predictions.interval
        ratio = state.stamps.ratio(state.stamps.duration)
        twist = (state.pose.inverse() @ outcome.match.pose).as_array() / interval.length
        first, features = (self._extract(each, ratio * twist, again=True) for each in (state.window.latest.features.scan, scan))
        interval = dataclasses.replace(interval, middle_offset=middle_offset(scan, features, ratio))
        update.start_in_motion(state, first, twist, interval.middle_offset)
        return features, dataclasses.replace(predictions, interval=interval)


def search_parameters(parameters: Parameters) -> Parameters:
    """Parameters of the registrations to single references.

    Where a window follows, its alignment is final: the registration is not polished, and walls count as parallel as they
    do in the window.
    """
    if parameters.odometry.reference != 'window':
        return parameters
    refinement = dataclasses.replace(parameters.refinement, polish_iterations=0)
    tolerance = max(parameters.decision.parallel_tolerance, parameters.degeneracy.parallel_tolerance)
    return dataclasses.replace(parameters, refinement=refinement,
                               decision=dataclasses.replace(parameters.decision, parallel_tolerance=tolerance))
