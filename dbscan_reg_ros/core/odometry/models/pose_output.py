# SPDX-License-Identifier: Apache-2.0
"""Poses as they are published: with the Manhattan heading, and averaged while the sensor stands still."""
from ...geometry.se2 import SE2
from .zero_velocity import ZeroVelocityUpdate


class PoseOutput:
    """Makes published poses of the poses by which scans are registered.

    The heading correction applies to published poses only: scans are registered without it.

    Parameters
    ----------
    pose : SE2
        At first.
    number : int
        Of the next scan.

    Attributes
    ----------
    number : int
        Of the next scan: how many were published before it, resets included.
    """

    def __init__(self, pose: SE2, number: int = 0):
        self._correction, self._published, self.number = SE2(), pose, number
        self.restart(pose)

    def restart(self, pose: SE2) -> None:
        """Start averaging anew at `pose`."""
        self._zero_velocity = ZeroVelocityUpdate(pose)

    def corrected(self, pose: SE2) -> SE2:
        """A `pose` in the published odometry frame."""
        return self._correction @ pose

    def turn(self, pose: SE2, rotation: float) -> None:
        """Correct headings from now on by a `rotation` [rad] about the sensor at `pose`."""
        published = self.corrected(pose)
        self._correction = SE2(published.x, published.y, published.theta + rotation) @ pose.inverse()

    def averaged(self, pose: SE2, covariance, interval: float, gate: float) -> SE2:
        """As `ZeroVelocityUpdate.update`."""
        return self._zero_velocity.update(pose, covariance, interval, gate)

    def publish(self, pose: SE2) -> tuple[SE2, SE2]:
        """The published pose for `pose`, and the increment since the one before it, in that one's frame."""
        self.number += 1
        before, self._published = self._published, self.corrected(pose)
        return self._published, before.inverse() @ self._published
