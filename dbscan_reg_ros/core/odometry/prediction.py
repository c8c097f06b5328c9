# SPDX-License-Identifier: Apache-2.0
"""Prediction of the pose of a scan before it is registered."""
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.se2 import SE2
from ..parameters.tree import Parameters
from ..registration.records import Prior
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
        Covariance of `pose` in the frame of the sensor [m, m, rad], enlarged while scans are not found.
    """

    pose: SE2
    prior: Prior
    gate_covariance: NDArray[np.float64]


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
    unconstrained_time: float = 0.0

    @property
    def by_motion_model(self) -> bool:
        """Whether there is no external prior, neither of the motion nor of the rotation."""
        return self.best is self.motion


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
