# SPDX-License-Identifier: Apache-2.0
"""Propagation of the covariance of pose and twist from scan to scan."""
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...geometry.se2 import SE2
from ...registration.records import Prior


class PoseMeasurement(NamedTuple):
    """How a scan's alignment with the map corrects its predicted pose.

    Attributes
    ----------
    gain : (3, 3) float
        Kalman gain, in the frame of the scan: the identity takes the pose from the map, 0 from the prediction.
    covariance : (3, 3) float
        Covariance of the pose by the map alone, in the frame of the scan [m, m, rad].
    """

    gain: NDArray[np.float64]
    covariance: NDArray[np.float64]


NO_MEASUREMENT = PoseMeasurement(np.zeros((3, 3)), np.zeros((3, 3)))
"""Dead reckoning: the map does not correct the prediction."""


class CovariancePropagation:
    """Joint covariance of the errors of pose and twist, in the frame of the sensor [m, m, rad; m/s, m/s, rad/s].

    Along a degenerate direction the error of the twist is kept, and the error of the pose grows with it.
    """

    def __init__(self) -> None:
        # Rows and columns: pose, pose since the latest key frame, twist.
        self._joint = np.zeros((9, 9))
        self.reset_twist()

    @property
    def pose(self) -> NDArray[np.float64]:
        """``(3, 3)`` covariance of the pose."""
        return self._joint[:3, :3]

    @property
    def twist(self) -> NDArray[np.float64]:
        """``(3, 3)`` covariance of the twist."""
        return self._joint[6:, 6:]

    def reset_twist(self) -> None:
        """Reset the twist covariance to that of an unknown twist."""
        self._joint[6:] = self._joint[:, 6:] = 0.0
        self._joint[6:, 6:] = np.eye(3)

    def reduce_heading(self, ratio: float) -> None:
        """Multiply the standard deviation of the heading by a `ratio`."""
        self._joint[2] *= ratio
        self._joint[:, 2] *= ratio

    def start_key_frame(self) -> None:
        """Make the current pose the latest key frame's."""
        self._joint[3:6] = self._joint[:, 3:6] = 0.0

    def add_unknown_motion(self) -> None:
        """Add an unknown motion, after which a new key frame starts."""
        self._joint[:3, :3] += np.eye(3)
        self.start_key_frame()
        self.reset_twist()

    def propagate(self, step: SE2, interval: float, prior: Prior,
                  measurement: PoseMeasurement = NO_MEASUREMENT) -> None:
        """Propagate all covariances over a `step`.

        Parameters
        ----------
        step : SE2
            Motion since the last scan, in the last scan's frame.
        interval : float [s]
            Time since the last scan; 0 where unknown, which resets the twist.
        prior : Prior
            The predicted step.
        measurement : PoseMeasurement
        """
        gain = measurement.gain
        rate = 1.0 / interval if interval > 0.0 else 0.0
        prediction_gain, adjoint = np.eye(3) - gain, step.inverse().adjoint()
        # Six independent errors: the joint's three, change of the twist, rest of the prediction error, measurement.
        errors = np.zeros((18, 18))
        errors[:9, :9] = self._joint
        change = prior.covariance if prior.velocity_change is None else prior.velocity_change
        errors[9:12, 9:12] = change
        errors[12:15, 12:15] = prior.covariance - change
        errors[15:, 15:] = measurement.covariance
        # Their effect on the error of the step. The measurement removes the error made since the key frame.
        effect = np.zeros((3, 18))
        effect[:, 3:6] = -gain @ adjoint
        effect[:, 9:12] = effect[:, 12:15] = prediction_gain
        effect[:, 15:] = gain
        if prior.velocity_change is not None:
            # The variance of the twist stays below that of `reset_twist`: old errors fade as new ones are added.
            fading = np.sqrt(np.maximum(1.0 - rate * rate * change.diagonal(), 0.0))
            effect[:, 6:9] = interval * fading * prediction_gain
        transition = np.concatenate((effect, effect, rate * effect))
        transition[:3, :3] += adjoint
        transition[3:6, 3:6] += adjoint
        transition[6:, 12:15] = 0.0
        self._joint = transition @ errors @ transition.T
        if not rate:
            self.reset_twist()
