# SPDX-License-Identifier: Apache-2.0
"""Rigid motions of the plane: the only place that knows how poses compose (Eq. 8)."""
import math
from dataclasses import dataclass

import numpy as np


def wrap(angle):
    """Angle(s) [rad] wrapped to [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def turn_matrix(theta):
    """``(3, 3)`` matrix that turns (x, y, theta) by `theta`."""
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def turned(matrix, theta):
    """A ``(3, 3)`` matrix over (x, y, theta) with its axes turned by `theta` [rad]."""
    turn = turn_matrix(theta)
    return turn @ matrix @ turn.T


def as_complex(vectors):
    """Vectors ``(P, 2)`` as complex numbers ``(P,)``."""
    return np.ascontiguousarray(vectors, dtype=float).view(complex)[:, 0]


def as_vectors(numbers):
    """Complex numbers ``(P,)`` as vectors ``(P, 2)``."""
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
        """The motion that applies `other` first, then this one."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return SE2(self.x + c * other.x - s * other.y,
                   self.y + s * other.x + c * other.y,
                   wrap(self.theta + other.theta))

    def inverse(self) -> 'SE2':
        c, s = math.cos(self.theta), math.sin(self.theta)
        return SE2(-c * self.x - s * self.y, s * self.x - c * self.y, wrap(-self.theta))

    def apply(self, points):
        """Points ``(..., 2)`` [m] moved by this motion."""
        points = np.asarray(points, dtype=float)
        c, s = math.cos(self.theta), math.sin(self.theta)
        x, y = points[..., 0], points[..., 1]
        return np.stack((c * x - s * y + self.x, s * x + c * y + self.y), axis=-1)

    def rotation(self):
        """The ``(2, 2)`` rotation matrix."""
        c, s = math.cos(self.theta), math.sin(self.theta)
        return np.array([[c, -s], [s, c]])

    def adjoint(self):
        """The ``(3, 3)`` matrix that carries a right (body) perturbation of a motion across this one.

        ``(a @ b)`` has the body covariance ``Ad(b^-1) Ca Ad(b^-1)' + Cb``.
        """
        c, s = math.cos(self.theta), math.sin(self.theta)
        return np.array([[c, -s, self.y], [s, c, -self.x], [0.0, 0.0, 1.0]])

    def brief(self) -> str:
        """The motion rounded to 0.1 mm and 0.001 deg, as a text."""
        return f'x {self.x:.4f} m, y {self.y:.4f} m, theta {math.degrees(self.theta):.3f} deg'

    def as_array(self):
        """``(3,)``: x [m], y [m], theta [rad]."""
        return np.array([self.x, self.y, self.theta])

    @classmethod
    def from_array(cls, values) -> 'SE2':
        x, y, theta = map(float, values)
        return cls(x, y, wrap(theta))
