# SPDX-License-Identifier: Apache-2.0
"""Prediction of the pose of a scan before it is registered."""
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..geometry.se2 import SE2
from ..parameters.tree import Parameters
from ..registration.records import Prior
from ..sensor import Sensor
from .models.stamps import ScanInterval
from .state import TrackState


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
        Covariance of `pose` in the frame of the sensor [m, m, rad], as `ConstantVelocityModel.gate_covariance`.
    """

    pose: SE2
    prior: Prior
    gate_covariance: NDArray[np.float64]

    def of(self, sensor: Sensor) -> 'Prediction':
        """Return the prediction for another `sensor` that follows from this one for the first sensor."""
        return Prediction(sensor.pose_at(self.pose), sensor.prior_of(self.prior),
                          sensor.covariance_of(self.gate_covariance))


@dataclass(frozen=True, eq=False)
class Predictions:
    """All predictions for one scan.

    Attributes
    ----------
    best : Prediction
        Prediction from the external prior, corrected by the wheel calibration; without an external prior, that of the
        motion model.
    motion : Prediction
        Prediction of the motion model.
    external : Prior or None
        Motion from an external source, without the wheel calibration. None without an external prior, and if the
        external prior measures the rotation only.
    interval : ScanInterval
        Time since the last scan.
    unconstrained_time : float [s]
        Time since the last scan that constrained every direction.
    contradicted : Prior or None
        Motion from an external source that is not used, as the scan and the motion model contradict it.
    """

    best: Prediction
    motion: Prediction
    external: Prior | None
    interval: ScanInterval
    unconstrained_time: float
    contradicted: Prior | None = None

    @property
    def by_motion_model(self) -> bool:
        """Whether there is no external prior: neither of the whole motion nor of the rotation alone."""
        return self.best is self.motion

    def of(self, sensor: Sensor) -> 'Predictions':
        """Return the predictions for another `sensor` that follow from these for the first sensor."""
        if sensor.is_first:
            return self
        motion = self.motion.of(sensor)
        return replace(self, best=motion if self.by_motion_model else self.best.of(sensor), motion=motion,
                       external=self.external and sensor.prior_of(self.external))


def predict(state: TrackState, prior: Prior | None, interval: ScanInterval, parameters: Parameters) -> Predictions:
    """Predict the pose of a scan from the motion model and, if there is one, from an external prior.

    Parameters
    ----------
    state : TrackState
    prior : Prior or None
        Motion since the last scan from an external source; one that does not measure the translation is the prediction
        of the motion model with the rotation of a gyroscope.
    interval : ScanInterval
    parameters : Parameters
    """
    motion = _prediction(state, state.motion.predict(interval, parameters), parameters)
    if prior is None:
        return Predictions(motion, motion, None, interval, state.motion.unconstrained_time)
    external = prior if prior.measures_translation else None
    best = _prediction(state, prior if external is None else state.wheels.corrected(external), parameters)
    return Predictions(best, motion, external, interval, state.motion.unconstrained_time)


def _prediction(state: TrackState, prior: Prior, parameters: Parameters) -> Prediction:
    """Return the prediction that results from applying a `prior` to the last pose."""
    pose = state.pose @ prior.transform
    return Prediction(pose, prior, state.motion.gate_covariance(prior, pose, state.tracking.lost_time, parameters))
