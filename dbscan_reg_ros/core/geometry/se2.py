# SPDX-License-Identifier: Apache-2.0
"""Rigid motions of the plane and their composition (Eq. 8)."""
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from .array_types import ComplexArray, FloatArray
from .rounding import fixed

Angle = TypeVar('Angle', float, FloatArray)

RIGHT_ANGLE = 0.5 * math.pi
DOF = 3
"""Degrees of freedom of a motion of the plane: x, y and theta."""


def wrap(angle: Angle) -> Angle:
    """Wrap angle(s) [rad] to [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def wrap_period(angle: Angle, period: float) -> Angle:
    """Subtract whole periods from angle(s) [rad]; the result is at most half a period from 0."""
    wrapped: Angle = angle - period * np.rint(angle * (1.0 / period))
    return wrapped


def turn_matrix(theta: float) -> FloatArray:
    """Return the ``(3, 3)`` matrix that rotates (x, y, theta) by `theta` [rad]."""
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def turned(matrix: FloatArray, theta: float) -> FloatArray:
    """Rotate the axes of a ``(3, 3)`` covariance or information over (x, y, theta) by `theta` [rad]."""
    rotation = turn_matrix(theta)
    rotated: FloatArray = rotation @ matrix @ rotation.T
    return rotated


def unit_complex(angles: FloatArray) -> ComplexArray:
    """Return the unit complex numbers ``exp(1j * angles)``: multiplication by one rotates by its angle [rad]."""
    numbers: ComplexArray = np.exp(1j * angles)
    return numbers


def as_complex(vectors: ArrayLike) -> ComplexArray:
    """Return vectors ``(P, 2)`` as complex numbers ``(P,)``."""
    return np.ascontiguousarray(vectors, dtype=float).view(complex)[:, 0]


def as_vectors(numbers: ComplexArray) -> FloatArray:
    """Return complex numbers ``(P,)`` as vectors ``(P, 2)``."""
    return np.ascontiguousarray(numbers).view(float).reshape(-1, 2)


@dataclass(frozen=True, slots=True)
class SE2:
    """A pose or a rigid motion ``p -> Rot(theta) p + (x, y)``.

    Attributes
    ----------
    x, y : float
        Translation [m].
    theta : float
        Rotation [rad], counter-clockwise.
    """

    x: float = 0.0
    y: float = 0.0
    theta: float = 0.0

    def __matmul__(self, other: 'SE2') -> 'SE2':
        """Compose two motions: `other` is applied first, then this one."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return SE2(self.x + c * other.x - s * other.y,
                   self.y + s * other.x + c * other.y,
                   wrap(self.theta + other.theta))

    def inverse(self) -> 'SE2':
        """Return the motion that undoes this one."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return SE2(-c * self.x - s * self.y, s * self.x - c * self.y, wrap(-self.theta))

    def apply(self, points: ArrayLike) -> FloatArray:
        """Transform points ``(..., 2)`` [m] by this motion."""
        points = np.asarray(points, dtype=float)
        c, s = math.cos(self.theta), math.sin(self.theta)
        x, y = points[..., 0], points[..., 1]
        return np.stack((c * x - s * y + self.x, s * x + c * y + self.y), axis=-1)

    def rotation(self) -> FloatArray:
        """Return the ``(2, 2)`` rotation matrix."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return np.array([[c, -s], [s, c]])

    def adjoint(self) -> FloatArray:
        """Return the ``(3, 3)`` adjoint Ad, which maps perturbations in the body frame to the frame before this motion.

        ``(a @ b)`` has the body covariance ``Ad(b^-1) Ca Ad(b^-1)' + Cb``.
        """
        c, s = math.cos(self.theta), math.sin(self.theta)
        return np.array([[c, -s, self.y], [s, c, -self.x], [0.0, 0.0, 1.0]])

    def brief(self) -> str:
        """Format the motion, rounded to 0.1 mm and 0.001 deg."""
        return f'x {fixed(self.x, 4)} m, y {fixed(self.y, 4)} m, theta {fixed(math.degrees(self.theta), 3)} deg'

    def as_tuple(self) -> tuple[float, float, float]:
        """Return x [m], y [m] and theta [rad]."""
        return self.x, self.y, self.theta

    def as_array(self) -> FloatArray:
        """Return x [m], y [m] and theta [rad] as an array ``(3,)``."""
        return np.array([self.x, self.y, self.theta])

    @classmethod
    def from_array(cls, values: Iterable[float]) -> 'SE2':
        """Make a motion from x [m], y [m] and theta [rad]; the angle is wrapped."""
        x, y, theta = map(float, values)
        return cls(x, y, wrap(theta))
