# SPDX-License-Identifier: Apache-2.0
"""Point-to-line correspondences of a scan with all key frames."""
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..geometry.robust_kernel import kernel
from ..geometry.se2 import SE2, wrap


class PosePrior(NamedTuple):
    """Gaussian prior of a pose.

    Attributes
    ----------
    pose : SE2
        Mean in the odometry frame.
    information : (3, 3) float
        Information (inverse covariance) for (x, y, theta); its frame and units are stated where it is used.
    """

    pose: SE2
    information: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Correspondences:
    """M pairs of a point of a scan and the line of a key frame on which the point lies.

    Attributes
    ----------
    pose : SE2
        Pose of the scan at which the pairs were looked up, in the odometry frame.
    size : int
        Number of points of the scan.
    frame : (M,) int
        Index of the key frame of each pair.
    index : (M,) int
        Index of the point of each pair.
    rotated_points : (M,) complex [m]
        Points relative to the sensor, rotated into the odometry frame.
    rows : (4, M) float
        The `point_to_line.linear_residuals` of the pairs at `pose`, for rotations about the sensor.
    weights : (M,) float or None
        Weight of each pair, from 0 to 1; None: all weights are 1.
    """

    pose: SE2
    size: int
    frame: NDArray[np.intp]
    index: NDArray[np.intp]
    rotated_points: NDArray[np.complex128]
    rows: NDArray[np.float64]
    weights: NDArray[np.float64] | None = None

    def match(self, step: NDArray[np.float64], scale: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return errors [m] and weights ``(M,)`` after a `step` ``(4,)``, weighted with a kernel of the `scale` [m].

        The weights of all pairs of one point sum to at most 1.
        """
        error = step @ self.rows
        weight = kernel(error, scale)
        weight /= np.maximum(np.bincount(self.index, weight, self.size), 1.0).take(self.index)
        return error, weight if self.weights is None else weight * self.weights

    def step(self, other: SE2) -> NDArray[np.float64]:
        """Return the homogeneous step ``(4,)`` from `pose` to another pose: (dx, dy, dtheta, 1) [m, m, rad, 1]."""
        pose = self.pose
        return np.array((other.x - pose.x, other.y - pose.y, wrap(other.theta - pose.theta), 1.0))


class Pairs(NamedTuple):
    """Pairs of a point and a line of a key frame, M of them.

    Attributes
    ----------
    frame : (M,) int
        Index of the key frame.
    point : (M,) int
        Index of the point.
    rotated_points : (M,) complex [m]
        Points relative to the sensor, rotated into the odometry frame.
    normals : (M,) complex
        Conjugated normals of the lines in the odometry frame, times the `OrientedPoints.inverse_noise` of the points.
    error : (M,) float [m]
        Signed distances of the points from the lines, times the `OrientedPoints.inverse_noise` of the points.
    """

    frame: NDArray[np.intp]
    point: NDArray[np.intp]
    rotated_points: NDArray[np.complex128]
    normals: NDArray[np.complex128]
    error: NDArray[np.float64]
