# SPDX-License-Identifier: Apache-2.0
"""Sensors on one rigid body: a state of the first sensor seen from another one, and back."""
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..geometry.se2 import SE2
from ..registration.records import Prior

_IDENTITY = SE2()


@dataclass(frozen=True)
class Sensor:
    """One of the lidars of a robot.

    The odometry follows the first sensor. Scans of another one are registered in its own frame; what is predicted is
    transformed to this frame before, and what is found is transformed back.

    Attributes
    ----------
    name : str
        Unique name; all scans of the sensor carry it.
    pose : SE2
        Pose of the sensor in the frame of the first sensor; the identity for the first.
    """

    name: str = ''
    pose: SE2 = _IDENTITY

    @property
    def is_first(self) -> bool:
        """Whether the frame of this sensor is that of the first one: nothing has to be transformed."""
        return self.pose == _IDENTITY

    def pose_at(self, first: SE2) -> SE2:
        """Return the pose of this sensor where the `first` sensor is at that pose; both in one frame."""
        return first if self.is_first else first @ self.pose

    def first_at(self, pose: SE2) -> SE2:
        """Return the pose of the first sensor where this one is at `pose`; both in one frame."""
        return pose if self.is_first else pose @ self.pose.inverse()

    def twist_of(self, first: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the twist ``(3,)`` of this sensor for a twist of the `first` [m/s, m/s, rad/s], each in its frame."""
        return first if self.is_first else self.pose.inverse().adjoint() @ first

    def first_twist(self, twist: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the `twist` ``(3,)`` of this sensor as that of the first [m/s, m/s, rad/s], each in its frame."""
        return twist if self.is_first else self.pose.adjoint() @ twist

    def prior_of(self, first: Prior) -> Prior:
        """Return a prior of the motion of the `first` sensor as one of this sensor."""
        return first if self.is_first else _seen_from(self.pose, first)

    def first_prior(self, prior: Prior) -> Prior:
        """Return a `prior` of the motion of this sensor as one of the first."""
        return prior if self.is_first else _seen_from(self.pose.inverse(), prior)

    def covariance_of(self, first: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a pose covariance ``(3, 3)`` in the frame of the `first` sensor, in that of this one."""
        return first if self.is_first else _carried(self.pose.inverse().adjoint(), first)

    def first_covariance(self, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a pose `covariance` ``(3, 3)`` in the frame of this sensor, in that of the first."""
        return covariance if self.is_first else _carried(self.pose.adjoint(), covariance)

    def first_gain(self, gain: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a linear map ``(3, 3)`` of small motions in the frame of this sensor, in that of the first."""
        return gain if self.is_first else self.pose.adjoint() @ gain @ self.pose.inverse().adjoint()


def _carried(adjoint: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the `covariance` ``(3, 3)`` of small motions that an `adjoint` takes to another frame."""
    carried: NDArray[np.float64] = adjoint @ covariance @ adjoint.T
    return carried


def _seen_from(pose: SE2, prior: Prior) -> Prior:
    """Return a prior of the motion of a frame as one of the frame at `pose` in it."""
    adjoint = pose.inverse().adjoint()
    change = None if prior.velocity_change is None else _carried(adjoint, prior.velocity_change)
    return Prior(pose.inverse() @ prior.transform @ pose, _carried(adjoint, prior.covariance), change)


FIRST = Sensor()
"""The only sensor of most robots."""
