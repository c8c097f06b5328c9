# SPDX-License-Identifier: Apache-2.0
"""Several sensors on one rigid body: transforms of poses, twists and covariances between them."""
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .errors import expect
from .geometry.se2 import SE2
from .parameters.features import ScanParameters
from .registration.records import Prior

_IDENTITY = SE2()


@dataclass(frozen=True)
class Sensor:
    """One of the lidars of a robot.

    The odometry estimates the pose of the first sensor. Scans of another sensor are registered in its own frame: the
    prediction is transformed to this frame before the registration, and the result is transformed back.

    Attributes
    ----------
    name : str
        Unique name of the sensor.
    pose : SE2
        Pose of the sensor in the frame of the first sensor; the identity for the first.
    rank : int
        0 for a sensor whose mounting counts as right. Others are compared with these, and used only if they agree.
    limits : ScanParameters or None
        Limits of its ranges and range noise, and its direction; None: those of the parameters of the odometry.
    """

    name: str = ''
    pose: SE2 = _IDENTITY
    rank: int = 0
    limits: ScanParameters | None = None

    def __post_init__(self) -> None:
        expect('pose', self.pose, SE2, 'SE2(x, y, theta) [m, m, rad]')

    @cached_property
    def is_first(self) -> bool:
        """Whether this is the first sensor, for which nothing has to be transformed."""
        return self.pose == _IDENTITY

    def pose_at(self, first: SE2) -> SE2:
        """Return the pose of this sensor from the pose of the `first` sensor, in the same frame."""
        return first if self.is_first else first @ self.pose

    def first_at(self, pose: SE2) -> SE2:
        """Return the pose of the first sensor from the `pose` of this sensor, in the same frame."""
        return pose if self.is_first else pose @ self.pose.inverse()

    def twist_of(self, first: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the twist of this sensor from the twist of the `first` sensor, ``(3,)`` [m/s, m/s, rad/s]."""
        return first if self.is_first else self.pose.inverse().adjoint() @ first

    def first_twist(self, twist: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the twist of the first sensor from the `twist` of this sensor, ``(3,)`` [m/s, m/s, rad/s]."""
        return twist if self.is_first else self.pose.adjoint() @ twist

    def prior_of(self, first: Prior) -> Prior:
        """Return the prior for the motion of this sensor from a prior for the motion of the `first` sensor."""
        return first if self.is_first else _seen_from(self.pose, first)

    def first_prior(self, prior: Prior) -> Prior:
        """Return the prior for the motion of the first sensor from a `prior` for the motion of this sensor."""
        return prior if self.is_first else _seen_from(self.pose.inverse(), prior)

    def covariance_of(self, first: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform a pose covariance ``(3, 3)`` from the frame of the first sensor to the frame of this sensor."""
        return first if self.is_first else _carried(self.pose.inverse().adjoint(), first)

    def first_covariance(self, covariance: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform a pose `covariance` ``(3, 3)`` from the frame of this sensor to the frame of the first sensor."""
        return covariance if self.is_first else _carried(self.pose.adjoint(), covariance)

    def first_gain(self, gain: NDArray[np.float64]) -> NDArray[np.float64]:
        """Transform a Kalman `gain` ``(3, 3)`` from the frame of this sensor to the frame of the first sensor."""
        return gain if self.is_first else self.pose.adjoint() @ gain @ self.pose.inverse().adjoint()


def _carried(adjoint: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transform a `covariance` ``(3, 3)`` of small motions to another frame with the `adjoint` of that transform."""
    carried: NDArray[np.float64] = adjoint @ covariance @ adjoint.T
    return carried


def _seen_from(pose: SE2, prior: Prior) -> Prior:
    """Return the prior for the motion of a frame that is at `pose` in another frame, from a `prior` for the latter."""
    adjoint = pose.inverse().adjoint()
    change = None if prior.velocity_change is None else _carried(adjoint, prior.velocity_change)
    return replace(prior, transform=pose.inverse() @ prior.transform @ pose,
                   covariance=_carried(adjoint, prior.covariance), velocity_change=change)


FIRST = Sensor()
"""The only sensor of most robots."""
