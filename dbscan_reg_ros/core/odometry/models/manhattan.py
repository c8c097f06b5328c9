# SPDX-License-Identifier: Apache-2.0
"""Manhattan heading correction: most walls of a building share two perpendicular directions."""
import math

import numpy as np
from numpy.typing import NDArray

from ...features.records import Segments
from ...geometry.robust_kernel import kernel
from ...geometry.se2 import DOF, RIGHT_ANGLE, SE2, wrap_period
from ...geometry.ties import first_largest
from ...geometry.tolerance import TINY
from ...parameters.odometry import ManhattanParameters


class ManhattanHeading:
    """Kalman filter of the dominant wall direction, modulo a right angle.

    After Coughlan and Yuille, "Manhattan World", ICCV 1999. The state is three angles [rad]: the heading drift, a
    random walk; the deviation of the visible walls from the dominant direction, which fades with distance; and the
    dominant direction itself. The estimated drift is removed from the heading at once, so its mean stays 0.
    """

    def __init__(self) -> None:
        self._covariance = np.zeros((DOF, DOF))
        self._forget()

    def _forget(self) -> None:
        """Discard the dominant direction; the variance of the heading drift is kept."""
        self._direction: float | None = None
        self._deviation = 0.0
        self._aligned_length = self._total_length = 0.0
        self._path = self._distance = 0.0

    def propagate(self, step: SE2) -> None:
        """Add the length of a `step` to the distance travelled, by which the drift grows at the next observation."""
        distance = math.hypot(step.x, step.y)
        self._distance += distance
        self._path += math.hypot(distance, step.theta)

    def observe(self, segments: Segments, heading: float, parameters: ManhattanParameters) -> tuple[float, float]:
        """Estimate the heading drift from the visible walls.

        Parameters
        ----------
        segments : Segments
            Segments of a scan, in the frame of the sensor.
        heading : float [rad]
            Heading of the sensor.
        parameters : ManhattanParameters

        Returns
        -------
        rotation : float [rad]
            Correction to add to the heading.
        ratio : float
            Standard deviation of the heading drift after the correction divided by the one before the correction.
        """
        p = parameters
        self._predict(p)
        walls = segments.length > _MIN_WALL_LENGTH
        length, directions = segments.length[walls], segments.direction[walls] + heading
        if not len(length):
            return 0.0, 1.0
        if self._direction is None:
            self._direction = _densest_direction(directions, length, _DIRECTION_SIGMA)
            drift = self._covariance[0, 0]
            self._covariance = np.diag((drift, _WALL_SIGMA ** 2, _UNKNOWN_SIGMA ** 2))
        offsets = wrap_period(directions - self._direction - self._deviation, RIGHT_ANGLE)
        innovation, aligned_length = _mean_shift(offsets, length, _DIRECTION_SIGMA)
        common = self._covariance.sum(0)
        variance = common.sum() + _OBSERVATION_SIGMA ** 2 * max(_REFERENCE_LENGTH / aligned_length, 1.0)
        if innovation * innovation > _GATE ** 2 * variance:
            aligned_length = 0.0
        if not self._count_walls(aligned_length, length.sum()):
            return 0.0, 1.0
        gain, before = common / variance, self._covariance[0, 0]
        self._covariance = self._covariance - gain[:, None] * common
        self._deviation += gain[1] * innovation
        self._direction += gain[2] * innovation
        ratio = math.sqrt(max(self._covariance[0, 0], 0.0) / before) if before else 1.0
        return -gain[0] * innovation, ratio

    def _count_walls(self, aligned_length: float, total_length: float) -> bool:
        """Add the lengths [m] of walls, and return whether enough of the length is along the dominant direction."""
        self._aligned_length += aligned_length
        self._total_length += total_length
        ratio = self._aligned_length / self._total_length
        if ratio < _FORGET_RATIO:
            self._forget()
        return ratio >= _MIN_ALIGNED_RATIO and bool(aligned_length)

    def _predict(self, p: ManhattanParameters) -> None:
        """Kalman prediction: add process noise and fade the deviation for the distance since the last observation."""
        fading = math.exp(-self._distance / _CORRELATION_DISTANCE)
        transition = np.array((1.0, fading, 1.0))
        self._covariance = transition[:, None] * self._covariance * transition
        self._covariance[0, 0] += p.heading_drift ** 2 * self._path
        self._covariance[1, 1] += (1.0 - fading * fading) * _WALL_SIGMA ** 2
        self._deviation = fading * self._deviation
        self._aligned_length, self._total_length = fading * self._aligned_length, fading * self._total_length
        self._path = self._distance = 0.0


def _densest_direction(directions: NDArray[np.float64], length: NDArray[np.float64], sigma: float) -> float:
    """Return the direction [rad] around which walls within about `sigma` [rad] have the greatest length [m]."""
    density = kernel(wrap_period(directions[:, None] - directions, RIGHT_ANGLE), sigma) @ length
    return float(directions[first_largest(density)])


def _mean_shift(offsets: NDArray[np.float64], length: NDArray[np.float64], sigma: float) -> tuple[float, float]:
    """Return the mode of wall `offsets` [rad] nearest to 0 by mean shift, and the length [m] of the walls at it."""
    mean = 0.0
    for _ in range(_ITERATIONS):
        weight = length * kernel(offsets - mean, sigma)
        aligned_length = weight.sum() + TINY
        mean = weight @ offsets / aligned_length
    return mean, aligned_length


_MIN_WALL_LENGTH = 0.7
"""Segments shorter than this [m] are not used as walls: they are mostly furniture."""
_OBSERVATION_SIGMA = 0.009
"""Standard deviation [rad] of the direction observed in one scan from `_REFERENCE_LENGTH` of walls."""
_REFERENCE_LENGTH = 3.0
"""An observation from a smaller length of aligned walls [m] gets a larger standard deviation."""
_UNKNOWN_SIGMA = 2.0
"""Standard deviation [rad] assumed for an unknown direction."""
_GATE = 2.0
"""If the visible walls deviate by more standard deviations than this, they have another dominant direction."""
_ITERATIONS = 3
"""Number of iterations of the mean shift."""
_WALL_SIGMA = 0.012
"""Standard deviation [rad] of the angle between the walls at one place and the dominant direction, as built."""
_CORRELATION_DISTANCE = 20.0
"""Distance [m] over which that angle is correlated: about the length of a wing."""
_DIRECTION_SIGMA = 0.035
"""Standard deviation [rad] of the angle between a wall and the direction that it is parallel to."""
_MIN_ALIGNED_RATIO = 0.5
"""The heading is corrected only where at least this ratio of the length of the walls follows the dominant direction."""
_FORGET_RATIO = 0.25
"""Ratio of aligned walls below which the direction is discarded."""
