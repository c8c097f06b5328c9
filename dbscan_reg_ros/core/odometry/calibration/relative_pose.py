# SPDX-License-Identifier: Apache-2.0
"""Mounting and time offset of a lidar relative to the first one: their estimate, its error, and how comparisons fit."""
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...geometry.array_types import FloatArray
from ...geometry.se2 import DOF, SE2, wrap


class Comparison(NamedTuple):
    """One scan of a further lidar, located in the map of the first lidar.

    Attributes
    ----------
    relative : SE2
        Pose of the further lidar in the frame of the first one at the stamp of this scan.
    covariance : (3, 3) float
        Covariance of `relative` in the frame of the further lidar [m, m, rad].
    twist : (3,) float
        Velocity of the first lidar at this stamp, in its frame [m/s, m/s, rad/s].
    twist_covariance : (3, 3) float
        In the frame of the first lidar.
    group : int
        Comparisons of one group have errors in common, because their part of the map is the same.
    """

    relative: SE2
    covariance: FloatArray
    twist: FloatArray
    twist_covariance: FloatArray
    group: int


class RelativePose(NamedTuple):
    """Mounting and time offset of a further lidar relative to the first one.

    Attributes
    ----------
    pose : SE2
        Pose of the further lidar in the frame of the first one.
    time_offset : float [s]
        Time to be added to the stamps of the further lidar.
    covariance : (4, 4) float
        Covariance of x, y, yaw and time offset [m, m, rad, s].
    """

    pose: SE2
    time_offset: float
    covariance: FloatArray

    @property
    def sigmas(self) -> FloatArray:
        """Standard deviations ``(4,)`` of x, y, yaw and time offset [m, m, rad, s]."""
        return np.sqrt(self.covariance.diagonal())

    @property
    def observable(self) -> NDArray[np.bool_]:
        """``(4,)``: whether the comparisons determine x, y, yaw and time offset."""
        return self.sigmas < LIMITS


class Disagreement(NamedTuple):
    """By how much mounting and time offset of a lidar differ from what the scans show; 0: insignificantly.

    Attributes
    ----------
    distance : float [m]
    rotation : float [rad]
        Difference of the mounting by the scans from the given one.
    time_offset : float [s]
        Time to be added to the stamps.
    """

    distance: float
    rotation: float
    time_offset: float

    def __str__(self) -> str:
        distance = f'{100.0 * self.distance:.1f} cm' if self.distance else ''
        rotation = f'{math.degrees(abs(self.rotation)):.1f} deg' if self.rotation else ''
        mounting = ' and '.join(filter(None, (distance, rotation)))
        mounting = mounting and f'its mounting is off by {mounting}'
        stamps = f'its stamps are off by {1e3 * abs(self.time_offset):.0f} ms' if self.time_offset else ''
        return ' and '.join(filter(None, (mounting, stamps))) or 'its mounting or its stamps are off'


def difference(given: SE2, estimate: RelativePose, time_offset: float = 0.0) -> Disagreement:
    """Return by how much an estimate differs from a `given` mounting and `time_offset` [s].

    What has little effect, or is below two standard deviations, is 0.
    """
    x, y, yaw, time = np.maximum(2.0 * estimate.sigmas, _LITTLE)
    shift = estimate.pose.x - given.x, estimate.pose.y - given.y
    rotation, late = (given.inverse() @ estimate.pose).theta, estimate.time_offset - time_offset
    shifted = abs(shift[0]) > x or abs(shift[1]) > y
    return Disagreement(math.hypot(*shift) if shifted else 0.0, rotation if abs(rotation) > yaw else 0.0,
                        late if abs(late) > time else 0.0)


def misfits(comparisons: Sequence[Comparison], pose: SE2, time_offset: float) -> FloatArray:
    """Return the chi-square ``(N,)`` of each comparison for a mounting and a time offset [s].

    What has little effect is added to its covariance.
    """
    data = _Data.of(comparisons, _LITTLE[:DOF])
    error, _ = data.linearised(np.array([*pose.as_tuple(), time_offset]))
    return data.squared(error)


def estimate_relative_pose(comparisons: Sequence[Comparison], guess: SE2) -> RelativePose:
    """Estimate mounting and time offset by robust least squares over all comparisons.

    A scan that is stamped too early by the time offset dt was measured when the first lidar had moved on by
    ``exp(dt twist)``. So the relative pose that is observed is ``exp(dt twist) X`` for a mounting X.

    The noise of the twists makes the time offset seem known, and too small (errors in variables). The information of
    this noise is subtracted at the end. If it is most of it, the time offset is not known. Nothing but the comparisons
    and a wide prior around `guess` determines the result: where the drive does not constrain a parameter, its variance
    is that of the prior.

    Parameters
    ----------
    comparisons : sequence of Comparison
    guess : SE2
        Mean of the prior for the mounting; its standard deviations are `PRIOR`.
    """
    data, mean = _Data.of(comparisons, _LEAST), np.array([*guess.as_tuple(), 0.0])
    state, prior = mean.copy(), np.diag(PRIOR ** -2.0)
    for _ in range(_ITERATIONS):
        error, jacobian = data.linearised(state)
        squared = data.squared(error)
        scale = max(float(np.median(squared)) / MEDIAN, 1.0)
        weights = 1.0 / (scale * (1.0 + squared / (_CUTOFF * scale)) ** 2)
        weighted = np.einsum('nik,nij,n->nkj', jacobian, data.information, weights)
        information = np.einsum('nkj,njl->kl', weighted, jacobian) + prior
        gradients = np.einsum('nkj,nj->nk', weighted, error)
        change = np.linalg.solve(information, gradients.sum(axis=0) + prior @ _wrapped(mean - state))
        state = state + change
        if np.abs(change).max() < _CONVERGED:
            break
    # The time offset without the noise of the twists; the mounting follows it.
    own, noise = 1.0 / float(np.linalg.inv(information)[DOF, DOF]), float(data.noise @ weights)
    is_known = noise < _MOST_NOISE * own
    change = state[DOF] * (noise / (own - noise) if is_known else -1.0) * np.append(
        -np.linalg.solve(information[:DOF, :DOF], information[:DOF, DOF]), 1.0)
    information[DOF, DOF] -= noise if is_known else own - PRIOR[DOF] ** -2.0
    state = state + change
    covariance = np.linalg.inv(information)
    scatter = covariance @ _scatter(weighted, gradients, data.groups) @ covariance
    return RelativePose(SE2.from_array(state[:DOF]), float(state[DOF]), covariance + scatter)


def _scatter(weighted: FloatArray, gradients: FloatArray, groups: NDArray[np.intp]) -> FloatArray:
    """Return the covariance ``(4, 4)`` of the summed gradients, whose errors are not independent within a group.

    It has two parts: what the groups show, and an error `_COMMON` of each group, since few groups show little.
    """
    count = int(groups.max()) + 1
    sums, common = np.zeros((count, DOF + 1)), np.zeros((count, DOF + 1, DOF))
    np.add.at(sums, groups, gradients)
    np.add.at(common, groups, weighted)
    common *= _COMMON
    scatter: FloatArray = sums.T @ sums + np.einsum('gki,gli->kl', common, common)
    return scatter


def _wrapped(difference: FloatArray) -> FloatArray:
    """Return a difference of states with its yaw wrapped."""
    difference[2] = wrap(difference[2])
    return difference


class _Data(NamedTuple):
    """N comparisons as arrays, in the frame of the first lidar.

    Attributes
    ----------
    relative : (N, 3) float
    information : (N, 3, 3) float
    twists : (N, 3) float
    noise : (N,) float
        Information about the time offset that the noise of the twist alone would give.
    groups : (N,) int
        Numbers of the groups, from 0.
    """

    relative: FloatArray
    information: FloatArray
    twists: FloatArray
    noise: FloatArray
    groups: NDArray[np.intp]

    @classmethod
    def of(cls, comparisons: Sequence[Comparison], sigmas: FloatArray) -> '_Data':
        """Collect the comparisons, with an error of these `sigmas` (x, y, yaw) [m, m, rad] more."""
        relative = np.array([each.relative.as_tuple() for each in comparisons])
        turns = np.array([SE2(theta=each.relative.theta).adjoint() for each in comparisons])
        covariance = turns @ np.array([each.covariance for each in comparisons]) @ turns.transpose(0, 2, 1)
        information = np.linalg.inv(covariance + np.diag(sigmas ** 2))
        noise = np.array([each.twist_covariance for each in comparisons])
        _, groups = np.unique([each.group for each in comparisons], return_inverse=True)
        return cls(relative, information, np.array([each.twist for each in comparisons]),
                   np.einsum('nij,nji->n', information, noise), groups)

    def squared(self, error: FloatArray) -> FloatArray:
        """Return the squared Mahalanobis distances ``(N,)`` of errors ``(N, 3)``."""
        squared: FloatArray = np.einsum('ni,nij,nj->n', error, self.information, error)
        return squared

    def linearised(self, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return errors ``(N, 3)`` and their Jacobians ``(N, 3, 4)`` at a `state` (x, y, yaw, time offset)."""
        x, y, yaw, offset = state
        vx, vy, omega = self.twists.T
        turned = omega * offset
        c, s = np.cos(turned), np.sin(turned)
        half_c, half_s = np.cos(0.5 * turned), np.sin(0.5 * turned)
        at_x, at_y = c * x - s * y, s * x + c * y
        moved_x, moved_y = half_c * vx - half_s * vy, half_s * vx + half_c * vy
        predicted = np.stack((at_x + offset * moved_x, at_y + offset * moved_y, yaw + turned), axis=1)
        error = self.relative - predicted
        error[:, 2] = wrap(error[:, 2])
        jacobian = np.zeros((len(error), DOF, DOF + 1))
        jacobian[:, 0, 0], jacobian[:, 0, 1] = c, -s
        jacobian[:, 1, 0], jacobian[:, 1, 1] = s, c
        jacobian[:, 2, 2] = 1.0
        jacobian[:, 0, DOF] = moved_x - omega * at_y
        jacobian[:, 1, DOF] = moved_y + omega * at_x
        jacobian[:, 2, DOF] = omega
        return error, jacobian


PRIOR = np.array([0.5, 0.5, 0.3, 0.3])
"""Standard deviations of the prior of x, y, yaw and time offset [m, m, rad, s]."""
MEDIAN = 2.366
"""Median of the squared Mahalanobis distance in three dimensions."""
LIMITS = np.array([0.05, 0.05, math.radians(1.0), 0.03])
"""A parameter whose standard deviation exceeds this is not observable [m, m, rad, s]."""
_LITTLE = np.array([0.01, 0.01, math.radians(0.3), 0.01])
"""Differences of x, y, yaw and time offset that have little effect on the odometry [m, m, rad, s]."""
_LEAST = np.array([0.002, 0.002, 0.001])
"""Least standard deviations of a comparison [m, m, rad]: the pose of the first lidar is interpolated."""
_COMMON = np.array([0.004, 0.004, math.radians(0.1)])
"""Standard deviations of the error that all comparisons of a group have in common [m, m, rad]."""
_ITERATIONS = 15
"""Largest number of iterations."""
_CONVERGED = 1e-6
"""The iterations end when no parameter changes by more than this [m, m, rad, s]."""
_MOST_NOISE = 0.5
"""Largest ratio of noise in the information about the time offset."""
_CUTOFF = 9.0
"""Squared Mahalanobis distance from which on a comparison counts as an outlier."""
