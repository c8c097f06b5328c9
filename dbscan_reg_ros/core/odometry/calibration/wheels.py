# SPDX-License-Identifier: Apache-2.0
"""Which of two lidars that disagree is wrong: the one whose motion differs from that of the wheels."""
import math
from collections import deque
from enum import Enum
from typing import NamedTuple

import numpy as np

from ...geometry.array_types import ComplexArray, FloatArray
from ...geometry.se2 import DOF, SE2, wrap
from ...geometry.symmetric_matrix import diagonal
from ...registration.records import Prior, Status
from ...scan import SECOND
from ..records import OdometryUpdate
from .relative_pose import RelativePose


class Wrong(Enum):
    """Which of two lidars is wrong, by the wheels."""

    UNKNOWN = 'unknown'
    FIRST = 'first'
    FURTHER = 'further'


class _Part(NamedTuple):
    """A short part of the drive, of about `_SPAN`.

    Attributes
    ----------
    lidar : (3,) float
        Motion of the base as the first lidar measures it [m, m, rad].
    wheels : (3,) float
        The same motion by the wheels.
    before, after : (3,) float
        Velocities of the base at the begin and at the end by the first lidar [m/s, m/s, rad/s].
    variance : (3,) float
        Sum of the variances of these velocities.
    """

    lidar: FloatArray
    wheels: FloatArray
    before: FloatArray
    after: FloatArray
    variance: FloatArray


class WheelComparison:
    """Compares the motion of the first lidar with that of the wheels.

    If the mounting of a lidar is off, a straight drive seems to go sideways by the error of its yaw, and a rotation
    moves the base by the error of its position. If its stamps are late, changes of the velocity come late.

    Parameters
    ----------
    base : SE2
        Pose of the base, whose motion the wheels measure, in the followed frame.
    """

    def __init__(self, base: SE2 = SE2()) -> None:
        self._base, self._to_base = base, base.inverse()
        self._parts: deque[_Part] = deque(maxlen=_MOST)
        self._begin: int | None = None
        self._twist, self._variance = np.zeros(DOF), np.zeros(DOF)
        self._lidar = self._wheels = SE2()

    def add(self, update: OdometryUpdate, prior: Prior | None) -> None:
        """Add the `update` of a scan, and the external `prior` that it was processed with."""
        if update.waits:
            return
        if prior is None or prior.velocity_change is not None or update.status is Status.FAILED:
            self._begin = None
        elif self._begin is not None:
            self._lidar @= update.increment
            self._wheels @= prior.transform
        if update.sensor.rank or update.status is not Status.OK:
            return
        if self._begin is not None and 0 <= update.stamp - self._begin < _SPAN:
            return
        adjoint = self._to_base.adjoint()
        twist, variance = adjoint @ update.twist, np.diagonal(adjoint @ update.twist_covariance @ adjoint.T)
        if self._begin is not None:
            lidar, wheels = (self._to_base @ each @ self._base for each in (self._lidar, self._wheels))
            if math.hypot(lidar.x, lidar.y) + abs(lidar.theta) > _STILL:
                self._parts.append(_Part(
                    lidar.as_array(), wheels.as_array(), self._twist, twist, self._variance + variance))
        self._begin, self._lidar, self._wheels = update.stamp, SE2(), SE2()
        self._twist, self._variance = twist, variance

    def restart(self) -> None:
        """Forget the part of the drive that has begun: the odometry is reset."""
        self._begin = None

    def wrong(self, given: SE2, estimate: RelativePose) -> Wrong:
        """Return which lidar is wrong if a further one disagrees with the first one.

        The wheels may have errors of their own: the scales of their distances and of their rotations are estimated
        as well. If their motion agrees neither with the one nor with the other lidar, the result is unknown.

        Parameters
        ----------
        given : SE2
            Mounting of the further lidar in the followed frame, as given.
        estimate : RelativePose
            Its mounting and time offset if the first lidar is right.
        """
        if len(self._parts) < _LEAST:
            return Wrong.UNKNOWN
        lidar, wheels, before, after, variance = (np.array(each) for each in zip(*self._parts, strict=True))
        # The same motions if the further lidar is right: the first one is at another pose, its stamps at other times.
        moved, offset = self._to_base @ given @ estimate.pose.inverse() @ self._base, estimate.time_offset
        other = _composed(_array(moved), -offset * before, lidar, offset * after, _array(moved.inverse()))
        noise = (variance * (offset / _SIGMA) ** 2).sum(axis=1)
        fraction, sigma = _fraction(_halfway(lidar), _halfway(other), _halfway(wheels), noise)
        for which, value in ((Wrong.FURTHER, 0.0), (Wrong.FIRST, 1.0)):
            if abs(fraction - value) < _NEAR and _CERTAIN * sigma < 0.5 - _NEAR:
                return which
        return Wrong.UNKNOWN


def _fraction(lidar: FloatArray, other: FloatArray, wheels: FloatArray, noise: FloatArray) -> tuple[float, float]:
    """Return how far the motions of the wheels are on the way from those of one lidar to those of the other.

    Robust least squares over N motions, with the scales of distances and rotations of the wheels. The noise of the
    difference of both lidars would make the fraction too small (errors in variables): its information is subtracted.

    Parameters
    ----------
    lidar, other, wheels : (N, 3) float
        The motions by the first lidar, by the other lidar, and by the wheels [m, m, rad].
    noise : (N,) float
        Information on the fraction that the noise of ``lidar - other`` alone would give.

    Returns
    -------
    fraction : float
        0 if the wheels agree with the first lidar, 1 if they agree with the other.
    sigma : float
        Its standard deviation; infinite if most of the information is noise.
    """
    error, difference = lidar - wheels, lidar - other
    for each in (error, difference):
        each[:, 2] = wrap(each[:, 2])
    jacobian = np.stack((difference, wheels * (1.0, 1.0, 0.0), wheels * (0.0, 0.0, 1.0)), axis=2) / _SIGMA[:, None]
    error, state, prior = error / _SIGMA, np.zeros(DOF), diagonal(0.0, _SCALE ** -2, _SCALE ** -2)
    information = prior
    for _ in range(_ITERATIONS):
        squared = ((error - jacobian @ state) ** 2).sum(axis=1) / (1.0 + noise)
        scale = max(float(np.median(squared)) / _MEDIAN, 1.0)
        weights = 1.0 / ((1.0 + noise) * scale * (1.0 + squared / (_CUTOFF * scale)) ** 2)
        information = np.einsum('nik,nil,n->kl', jacobian, jacobian, weights) + prior
        noisy = float(noise @ weights)
        if information[0, 0] - noisy <= max(noisy, _TINY):
            return 0.0, math.inf
        information[0, 0] -= noisy
        state = np.linalg.solve(information, np.einsum('nik,ni,n->k', jacobian, error, weights))
    return float(state[0]), math.sqrt(float(np.linalg.inv(information)[0, 0]))


def _array(motion: SE2) -> FloatArray:
    """Return a motion as an array ``(1, 3)``."""
    return motion.as_array()[None]


def _composed(*motions: FloatArray) -> FloatArray:
    """Return the composition of motions ``(N, 3)`` or ``(1, 3)`` [m, m, rad], one after the other."""
    moved: ComplexArray = np.zeros(1, dtype=complex)
    rotated: FloatArray = np.zeros(1)
    for each in motions:
        moved = moved + np.exp(1j * rotated) * (each[:, 0] + 1j * each[:, 1])
        rotated = rotated + each[:, 2]
    return np.stack((moved.real, moved.imag, rotated), axis=1)


def _halfway(motions: FloatArray) -> FloatArray:
    """Return motions ``(N, 3)`` with their translations relative to the heading halfway."""
    moved = (motions[:, 0] + 1j * motions[:, 1]) * np.exp(-0.5j * motions[:, 2])
    return np.stack((moved.real, moved.imag, motions[:, 2]), axis=1)


_SPAN = SECOND // 2
"""Duration [ns] of a part of the drive: changes of the velocity are seen, and the noise of its two poses is small."""
_MOST, _LEAST = 200, 10
"""Largest number of parts that are kept, and least number with which the wheels decide."""
_STILL = 0.02
"""Parts with less motion [m, rad] are not used."""
_SIGMA = np.array([0.005, 0.005, 0.005])
"""Standard deviations of the difference between lidar and wheels in a part [m, m, rad]."""
_SCALE = 0.1
"""Standard deviation of the errors of the scales of the wheels."""
_NEAR = 0.25
"""The wheels agree with a lidar if the fraction is this near to it."""
_CERTAIN = 2.0
"""Multiple of its standard deviation by which the fraction has to be on one side."""
_ITERATIONS = 10
"""Number of iterations."""
_MEDIAN = 2.366
"""Median of the squared Mahalanobis distance in three dimensions."""
_CUTOFF = 9.0
"""Squared Mahalanobis distance from which on a part counts as an outlier."""
_TINY = 1e-9
"""Least information on the fraction."""
