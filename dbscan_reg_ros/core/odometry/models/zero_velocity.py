# SPDX-License-Identifier: Apache-2.0
"""Zero-velocity update (ZUPT): the pose of a sensor at rest is the mean over its scans."""
import math

import numpy as np
from numpy.typing import NDArray

from ...geometry.se2 import SE2, wrap
from ...geometry.symmetric_matrix import mahalanobis


class ZeroVelocityUpdate:
    """Detects whether the sensor is at rest, and averages its poses while it is.

    Parameters
    ----------
    pose : SE2
        First pose of the sensor, which is assumed to be at rest.
    """

    def __init__(self, pose: SE2):
        self._mean, self._count, self._rest_time = pose, 1, math.inf

    def update(self, pose: SE2, covariance: NDArray[np.float64], interval: float, gate: float) -> SE2:
        """Average the pose of a scan with the poses of earlier scans, if the sensor is at rest.

        Parameters
        ----------
        pose : SE2
            Pose of the scan.
        covariance : (3, 3) float
            Covariance of `pose` in the frame of the sensor [m, m, rad].
        interval : float [s]
            Time since the last scan.
        gate : float
            If the Mahalanobis distance of `pose` from the mean exceeds this, the sensor has moved.

        Returns
        -------
        SE2
            The mean pose since the sensor came to rest, if it has been at rest for more than 1 s; otherwise `pose`.
        """
        offset = (self._mean.inverse() @ pose).as_tuple()
        # A direction that is hardly constrained proves no rest: the pose of a moving sensor stays within its gate.
        if covariance.trace() > _MAX_SIGMA ** 2:
            variance, axes = np.linalg.eigh(covariance)
            covariance = axes * np.minimum(variance, _MAX_SIGMA ** 2) @ axes.T
        if mahalanobis(offset, covariance) > gate ** 2:
            self._mean, self._count, self._rest_time = pose, 1, 0.0
            return pose
        self._count, self._rest_time = min(self._count + 1, _MAX_COUNT), self._rest_time + interval
        mean, gain = self._mean, 1.0 / self._count
        self._mean = SE2(mean.x + gain * (pose.x - mean.x), mean.y + gain * (pose.y - mean.y),
                         wrap(mean.theta + gain * wrap(pose.theta - mean.theta)))
        return self._mean if self._rest_time > _MIN_REST_TIME else pose


_MAX_SIGMA = 0.02
"""Rest is not detected from poses with a larger standard deviation [m], [rad]."""
_MAX_COUNT = 50
"""Number of scans in the running mean."""
_MIN_REST_TIME = 1.0
"""The sensor is at rest if its pose stays within the gate for this time [s]: even slow motion leaves the gate."""
