# SPDX-License-Identifier: Apache-2.0
"""A sensor that stands: its place is the mean of what the scans say, not the last one's noise."""
import math

from ...geometry.se2 import SE2, wrap
from ...geometry.symmetric_matrix import mahalanobis


class ZeroVelocityUpdate:
    """Tells rest from motion and averages poses at rest.

    Parameters
    ----------
    pose : SE2
        Where the sensor stands at first.
    """

    def __init__(self, pose: SE2):
        self._mean, self._count, self._lasted = pose, 1, math.inf

    def update(self, pose: SE2, covariance, interval, limit) -> SE2:
        """The pose to report for a scan.

        Parameters
        ----------
        pose : SE2
            Where the scan was found.
        covariance : (3, 3) array
            Of `pose`, in the sensor's own frame.
        interval : float
            Since the scan before [s].
        limit : float
            So many standard deviations from the mean the sensor has moved.

        Returns
        -------
        SE2
            The mean since the sensor stopped, once it has stood for a second; `pose` until then.
        """
        off = (self._mean.inverse() @ pose).as_array()
        if mahalanobis(off, covariance) > limit ** 2:
            self._mean, self._count, self._lasted = pose, 1, 0.0
            return pose
        self._count, self._lasted = min(self._count + 1, _MOST), self._lasted + interval
        mean, share = self._mean, 1.0 / self._count
        self._mean = SE2(mean.x + share * (pose.x - mean.x), mean.y + share * (pose.y - mean.y),
                         wrap(mean.theta + share * wrap(pose.theta - mean.theta)))
        return self._mean if self._lasted > _LONG else pose


# Of so many scans the mean is taken.
_MOST = 50
# Slow motion is no rest: this long within the limit [s].
_LONG = 1.0
