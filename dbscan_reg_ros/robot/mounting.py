# SPDX-License-Identifier: Apache-2.0
"""Where the laser sits on the base, and what its motion means for the base."""
import math
from dataclasses import dataclass, field

import numpy as np

from ..core.errors import DbscanRegError
from ..core.geometry.se2 import SE2, turn_matrix
from ..core.odometry.records import OdometryUpdate

LEVEL = math.cos(math.radians(20.0))
IDENTITY = SE2()


class MountingError(DbscanRegError, ValueError):
    """It is not known where the laser sits on the base, or it does not look along the plane of motion."""


@dataclass(frozen=True)
class Mounting:
    """The laser's place on the base.

    Attributes
    ----------
    pose : SE2
        Of an upright sensor with the laser's x axis, in the base frame.
    upside_down : bool
        The laser's z axis points down; `Scan.from_message` makes its scans those of the upright sensor.
    """

    pose: SE2 = IDENTITY
    upside_down: bool = False

    @property
    def place(self) -> SE2:
        """Where the sensor sits, turned to look along the base as its scans are: so they do not depend on its yaw."""
        return SE2(self.pose.x, self.pose.y)

    @classmethod
    def from_matrix(cls, matrix) -> 'Mounting':
        """The mounting of a laser with the transform `matrix` ``(4, 4)`` from its frame to the base's.

        Raises
        ------
        MountingError
            When the laser's axis is tilted by more than 20 degrees.
        """
        upward = matrix[2, 2]
        if not abs(upward) >= LEVEL:
            raise MountingError(f'the axis of the laser is tilted by {math.degrees(math.acos(upward)):.0f} deg against '
                                'the vertical of the base; expected it within 20 deg of straight up or down')
        yaw = math.atan2(matrix[1, 0], matrix[0, 0])
        return cls(SE2(float(matrix[0, 3]), float(matrix[1, 3]), yaw), bool(upward < 0.0))


@dataclass(frozen=True, eq=False)
class BaseState:
    """What the odometry means for the base.

    Attributes
    ----------
    stamp : int
        [ns]
    pose : SE2
        Of the base, in the odometry frame.
    covariance : (3, 3) float
        Of `pose`, for (x, y, theta) in the odometry frame.
    twist : (3,) float
        Velocity (vx, vy, omega) of the base in its own frame [m/s, m/s, rad/s].
    twist_covariance : (3, 3) float
    """

    stamp: int
    pose: SE2
    covariance: np.ndarray
    twist: np.ndarray
    twist_covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class Start:
    """Where the base is when the odometry starts.

    Attributes
    ----------
    pose : SE2
        In the odometry frame.
    covariance : (3, 3) float
        Of `pose`, for (x, y, theta) in the odometry frame.
    """

    pose: SE2 = IDENTITY
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))


AT_ORIGIN = Start()


def base_state(update: OdometryUpdate, origin: SE2, laser: SE2, start: Start = AT_ORIGIN) -> BaseState:
    """The state of the base from that of the sensor.

    Parameters
    ----------
    update : OdometryUpdate
    origin : SE2
        The sensor's pose in the odometry frame when the odometry started.
    laser : SE2
        The sensor's place on the base now.
    start : Start
        The base's place when the odometry started.
    """
    sensor = origin @ update.pose
    pose = sensor @ laser.inverse()
    moved = _lever(sensor, pose) @ turn_matrix(origin.theta)
    carried = _lever(start.pose, pose)
    covariance = moved @ update.covariance @ moved.T + carried @ start.covariance @ carried.T
    adjoint = laser.adjoint()
    return BaseState(update.stamp, pose, covariance, adjoint @ update.twist,
                     adjoint @ update.twist_covariance @ adjoint.T)


def _lever(place, pose):
    """``(3, 3)``: what a small motion at one place of a rigid body (x, y, theta) does at another."""
    return np.array([[1.0, 0.0, place.y - pose.y], [0.0, 1.0, pose.x - place.x], [0.0, 0.0, 1.0]])
