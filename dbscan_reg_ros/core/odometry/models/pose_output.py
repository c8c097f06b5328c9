# SPDX-License-Identifier: Apache-2.0
"""Published poses: with the Manhattan heading correction and the zero-velocity update."""
import numpy as np
from numpy.typing import NDArray

from ...geometry.se2 import SE2
from .zero_velocity import ZeroVelocityUpdate


class PoseOutput:
    """Converts the poses of registered scans to published poses.

    The heading correction is applied to the published poses only; scans are registered without it.

    Parameters
    ----------
    pose : SE2
        First pose of the sensor.
    number : int
        Number of the next scan.

    Attributes
    ----------
    number : int
        Number of the next scan: the number of scans published before it; a reset does not set it back to 0.
    """

    def __init__(self, pose: SE2, number: int):
        self._correction, self._published, self.number = SE2(), pose, number
        self.restart(pose)

    def restart(self, pose: SE2) -> None:
        """Restart the zero-velocity update at `pose`."""
        self._zero_velocity = ZeroVelocityUpdate(pose)

    def corrected(self, pose: SE2) -> SE2:
        """Transform a `pose` into the published odometry frame."""
        return self._correction @ pose

    def rotate_heading(self, pose: SE2, rotation: float) -> None:
        """Add a `rotation` [rad] about the sensor at `pose` to the heading correction."""
        published = self.corrected(pose)
        self._correction = SE2(published.x, published.y, published.theta + rotation) @ pose.inverse()

    def averaged(self, pose: SE2, covariance: NDArray[np.float64], interval: float, gate: float) -> SE2:
        """Apply `ZeroVelocityUpdate.update`."""
        return self._zero_velocity.update(pose, covariance, interval, gate)

    def publish(self, pose: SE2) -> tuple[SE2, SE2]:
        """Return the published pose for `pose`, and the increment in the frame of the previously published pose."""
        self.number += 1
        before, self._published = self._published, self.corrected(pose)
        return self._published, before.inverse() @ self._published
