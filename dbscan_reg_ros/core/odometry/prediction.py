# SPDX-License-Identifier: Apache-2.0
"""Where a scan is expected, before it is registered."""
from dataclasses import dataclass

import numpy as np

from ..geometry.se2 import SE2
from ..parameters.tree import Parameters
from ..registration.records import Prior
from .models.stamps import ScanInterval
from .state import TrackState


@dataclass(frozen=True, eq=False)
class Prediction:
    """Where one source expects a scan.

    Attributes
    ----------
    pose : SE2
        Predicted pose of the sensor in the odometry frame.
    prior : Prior
        Predicted motion since the last scan.
    gate_covariance : (3, 3) float
        Covariance of `pose` in the sensor's frame [m, m, rad], widened for the time in which scans were not found.
    """

    pose: SE2
    prior: Prior
    gate_covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class Predictions:
    """All predictions for one scan.

    Attributes
    ----------
    best : Prediction
        By the external prior, corrected by what was learned of it; by the motion model where there is none.
    motion : Prediction
        By the motion model.
    external : Prior or None
        A whole motion from an external source, as it was given; None where the motion model alone predicts, or an external
        source has given the rotation only.
    interval : ScanInterval
        The time since the last scan.
    """

    best: Prediction
    motion: Prediction
    external: Prior | None
    interval: ScanInterval


def predict(state: TrackState, prior: Prior | None, interval: ScanInterval, parameters: Parameters) -> Predictions:
    """Predict the pose of a scan by the motion model and, where there is one, by an external prior.

    Parameters
    ----------
    state : TrackState
    prior : Prior or None
        From an external source.
    interval : ScanInterval
    parameters : Parameters
    """
    own = state.motion.predict(interval, parameters)
    external = None if prior is None or prior.velocity_change is not None else prior
    used = prior or own
    if external is not None:
        used = state.wheels.corrected(external)

    def prediction(of: Prior) -> Prediction:
        pose = state.pose @ of.transform
        return Prediction(pose, of, state.motion.gate_covariance(of, pose, state.tracking.lost_time, parameters))
    motion = prediction(own)
    return Predictions(motion if used is own else prediction(used), motion, external, interval)
