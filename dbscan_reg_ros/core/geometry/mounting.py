# SPDX-License-Identifier: Apache-2.0
"""Mounting of a lidar on the robot's base."""
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..errors import DbscanRegError
from .se2 import SE2

_IDENTITY = SE2()
MAX_TILT = math.radians(20.0)
"""Largest angle [rad] between the lidar's z axis and the vertical of the base."""


class MountingError(DbscanRegError, ValueError):
    """The mounting of the lidar is unknown, or the lidar is tilted against the plane of motion."""


@dataclass(frozen=True)
class Mounting:
    """Pose of a planar lidar in the base frame.

    Scans are rotated by the yaw of `pose` before they are used, so the odometry estimates the motion of a sensor at
    `aligned_pose`.

    Attributes
    ----------
    pose : SE2
        Pose in the base frame; if the lidar is upside down, the pose of an upright sensor with the same x axis.
    upside_down : bool
        Whether the lidar's z axis points down; `Scan.from_message` then mirrors the bearings.
    """

    pose: SE2 = _IDENTITY
    upside_down: bool = False

    @property
    def aligned_pose(self) -> SE2:
        """Pose in the base frame of a sensor at the lidar's position, with its axes parallel to those of the base."""
        return SE2(self.pose.x, self.pose.y)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Matrix ``(4, 4)`` that transforms points from the lidar's frame, at the height of the base, to the base."""
        c, s, up = math.cos(self.pose.theta), math.sin(self.pose.theta), -1.0 if self.upside_down else 1.0
        return np.array(((c, -up * s, 0.0, self.pose.x), (s, up * c, 0.0, self.pose.y), (0.0, 0.0, up, 0.0),
                         (0.0, 0.0, 0.0, 1.0)))

    @classmethod
    def from_matrix(cls, matrix: NDArray[np.float64]) -> 'Mounting':
        """Make the mounting of a lidar from a transform in space.

        Parameters
        ----------
        matrix : (4, 4) float
            Transforms points [m] from the lidar's frame to the base frame.

        Raises
        ------
        MountingError
            When the lidar's z axis is tilted by more than `MAX_TILT`.
        """
        z_axis_up = float(matrix[2, 2])
        if not abs(z_axis_up) >= math.cos(MAX_TILT):
            raise MountingError(
                f'the z axis of the lidar is tilted by {math.degrees(math.acos(z_axis_up)):.0f} deg against that of '
                f'the base; expected at most {math.degrees(MAX_TILT):.0f} deg, upright or upside down; correct the '
                'transform or the mounting')
        yaw = math.atan2(matrix[1, 0], matrix[0, 0])
        return cls(SE2(float(matrix[0, -1]), float(matrix[1, -1]), yaw), z_axis_up < 0.0)
