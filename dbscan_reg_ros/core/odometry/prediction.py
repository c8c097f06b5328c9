# SPDX-License-Identifier: Apache-2.0
"""Prediction of the pose of a scan before it is registered."""
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..geometry.se2 import SE2
from ..parameters.tree import Parameters
from ..registration.records import Prior
from .models.motion import unknown_motion_covariance
from .models.stamps import ScanInterval
from .sensor import Sensor
from .state import Mode, TrackState


@dataclass(frozen=True, eq=False)
class Prediction:
    """Pose of a scan as predicted by one source.

    Attributes
    ----------
    pose : SE2
        Predicted pose of the sensor in the odometry frame.
    prior : Prior
        Predicted motion since the last scan.
    gate_covariance : (3, 3) float
        Covariance of `pose` in the frame of the sensor [m, m, rad], enlarged while scans are not found.
    """

    pose: SE2
    prior: Prior
    gate_covariance: NDArray[np.float64]

    def of(self, sensor: Sensor) -> 'Prediction':
        """Return this prediction of the first sensor as one of another `sensor`."""
        return Prediction(sensor.pose_at(self.pose), sensor.prior_of(self.prior),
                          sensor.covariance_of(self.gate_covariance))


@dataclass(frozen=True, eq=False)
class Predictions:
    """All predictions for one scan.

    Attributes
    ----------
    best : Prediction
        By the external prior, corrected by the wheel calibration; by the motion model where there is none.
    motion : Prediction
        By the motion model.
    external : Prior or None
        A whole motion from an external source, without correction. None where there is no external prior, or one of the
        rotation only.
    interval : ScanInterval
        Time since the last scan.
    unconstrained_time : float [s]
        Time since the last scan that constrained every direction.
    """

    best: Prediction
    motion: Prediction
    external: Prior | None
    interval: ScanInterval
    unconstrained_time: float

    @property
    def by_motion_model(self) -> bool:
        """Whether there is no external prior, neither of the motion nor of the rotation."""
        return self.best is self.motion

    def of(self, sensor: Sensor) -> 'Predictions':
        """Return these predictions of the first sensor as those of another `sensor`."""
        if sensor.is_first:
            return self
        motion = self.motion.of(sensor)
        return replace(self, best=motion if self.by_motion_model else self.best.of(sensor), motion=motion,
                       external=self.external and sensor.prior_of(self.external))


def predict(state: TrackState, prior: Prior | None, interval: ScanInterval, parameters: Parameters) -> Predictions:
    """Predict the pose of a scan by the motion model and, where there is one, by an external prior.

    Parameters
    ----------
    state : TrackState
    prior : Prior or None
        Motion since the last scan from an external source. One with a `Prior.velocity_change` is the prediction of the
        motion model with an external rotation.
    interval : ScanInterval
    parameters : Parameters
    """
    motion = _prediction(state, state.motion.predict(interval, parameters), parameters)
    if prior is None:
        return Predictions(motion, motion, None, interval, state.motion.unconstrained_time)
    external = prior if prior.velocity_change is None else None
    best = _prediction(state, prior if external is None else state.wheels.corrected(external), parameters)
    return Predictions(best, motion, external, interval, state.motion.unconstrained_time)


def _prediction(state: TrackState, prior: Prior, parameters: Parameters) -> Prediction:
    """Apply a `prior` to the last pose."""
    pose = state.pose @ prior.transform
    return Prediction(pose, prior, state.motion.gate_covariance(prior, pose, state.tracking.lost_time, parameters))


def coasting_prior(state: TrackState, predictions: Predictions, p: Parameters) -> Prior:
    """Return the best prior; any motion is possible while the motion model has no velocity yet."""
    prior = predictions.best.prior
    if state.tracking.mode is Mode.STARTING and predictions.by_motion_model:
        return Prior(prior.transform, unknown_motion_covariance(predictions.interval, p))
    return prior
