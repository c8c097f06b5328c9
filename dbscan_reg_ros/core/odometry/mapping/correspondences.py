# SPDX-License-Identifier: Apache-2.0
"""Point-to-line correspondences of a scan with all key frames, and robust alignment of the scan with them."""
import cmath
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...geometry.robust_kernel import kernel
from ...geometry.se2 import DOF, SE2, wrap
from ...geometry.symmetric_matrix import solve_one
from ...geometry.tolerance import TINY
from ...registration.point_to_line import normal_equations


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

    def equations(self, step: NDArray[np.float64], scale: float) -> NDArray[np.float64]:
        """Return `point_to_line.normal_equations` ``(4, 4)`` at `pose`, with the weights after a `step` ``(4,)``."""
        return normal_equations(self.rows, self.match(step, scale)[1])

    def mean_displacement(self, other: SE2) -> float:
        """Return the mean distance [m] by which the points move from `pose` to another pose."""
        x, y, theta = _difference(self.pose, other)
        distances = np.abs(complex(x, y) + (cmath.rect(1.0, theta) - 1.0) * self.rotated_points)
        return float(distances.sum()) / max(len(distances), 1)

    def step(self, other: SE2) -> NDArray[np.float64]:
        """Return the homogeneous step ``(4,)`` from `pose` to another pose: (dx, dy, dtheta, 1) [m, m, rad, 1]."""
        return np.array((*_difference(self.pose, other), 1.0))


def _difference(one: SE2, other: SE2) -> tuple[float, float, float]:
    """Return the difference of two poses [m, m, rad] in the odometry frame."""
    return other.x - one.x, other.y - one.y, wrap(other.theta - one.theta)


def weighted_by_agreement(correspondences: Correspondences, own: Correspondences, is_own: NDArray[np.bool_],
                          scale: float, noise: float) -> Correspondences:
    """Weight the pairs with key frames of other lidars by their agreement with the key frames of the own lidar.

    Lidars at different heights see different surfaces of an object. For each point, the mean error of its pairs with
    key frames of other lidars is compared with that of its pairs with own key frames. The weight is a Gaussian kernel
    of the difference of both means. Its scale is the standard deviation of this difference due to noise: where a point
    has no pair with an own key frame, the weights do not change.

    Parameters
    ----------
    correspondences : Correspondences
        Pairs of a scan with the key frames of all lidars.
    own : Correspondences
        Pairs of the same scan with the key frames of the own lidar, at a pose nearby.
    is_own : (K,) bool
        Which key frames of `correspondences` are those of the own lidar.
    scale : float [m]
        Scale of the kernel that weights the errors in their means.
    noise : float [m]
        Standard deviation of an error.
    """
    others = ~is_own.take(correspondences.frame)
    index, errors = correspondences.index[others], correspondences.rows[3, others]
    count, mean = _mean_errors(index, errors, correspondences.size, scale)
    own_count, own_mean = _mean_errors(own.index, own.step(correspondences.pose) @ own.rows, own.size, scale)
    sigma = noise * np.sqrt(1.0 / count + 1.0 / own_count)
    weights = np.ones(len(others)) if correspondences.weights is None else correspondences.weights.copy()
    weights[others] *= kernel((mean - own_mean) / sigma, 1.0).take(index)
    return replace(correspondences, weights=weights)


def _mean_errors(index: NDArray[np.intp], error: NDArray[np.float64], size: int,
                 scale: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return for each of `size` points the sum of the weights of its pairs, and their weighted mean error [m]."""
    weight = kernel(error, scale)
    count = np.maximum(np.bincount(index, weight, size), TINY)
    return count, np.bincount(index, weight * error, size) / count


def align(correspondences: Correspondences, start: SE2, prior: PosePrior, scales: Sequence[float],
          damping: float) -> SE2:
    """Align a scan with all key frames in robust point-to-line iterations, one iteration per entry of `scales` [m].

    Parameters
    ----------
    correspondences : Correspondences
        Correspondences that were looked up with the scan at a pose near the result.
    start : SE2
        Initial pose in the odometry frame.
    prior : PosePrior
        Its information is in the odometry frame, as a multiple of the information of one point.
    scales : sequence of float [m]
        Scale of the robust kernel in each iteration.
    damping : float
        Damping of the steps, as for `symmetric_matrix.solve`.
    """
    pose, step = correspondences.pose, correspondences.step(start)
    prior_gradient = prior.information @ _difference(prior.pose, pose)
    for scale in scales:
        equations = correspondences.equations(step, scale)
        equations[:DOF, :DOF] += prior.information
        equations[:DOF, DOF] += prior_gradient
        step[:DOF] = -solve_one(equations, damping)
    x, y, theta, _ = step.tolist()
    return SE2(pose.x + x, pose.y + y, wrap(pose.theta + theta))
