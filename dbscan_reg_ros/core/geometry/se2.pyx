# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, binding=True, cdivision=True
"""Rigid motions of the plane and their composition (Eq. 8)."""
import math

import numpy as np

from libc.math cimport atan2, cos, isfinite, sin

from .plane cimport wrap as wrapped_angle
from .symmetric cimport turn
from ..errors import ArgumentError
from .rounding import fixed

RIGHT_ANGLE = 0.5 * math.pi
DOF = 3
"""Degrees of freedom of a motion of the plane: x, y and theta."""
ROUGH = 1e-5
"""Rounding errors of a rotation matrix in single precision are below this."""


def wrap(angle):
    """Wrap angle(s) [rad] to [-pi, pi)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def wrap_period(angle, period):
    """Subtract whole periods from angle(s) [rad]; the result is at most half a period from 0."""
    return angle - period * np.rint(angle * (1.0 / period))


def turn_matrix(theta):
    """Return the ``(3, 3)`` matrix that rotates (x, y, theta) by `theta` [rad]."""
    c, s = math.cos(theta), math.sin(theta)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def lever_arm(x, y):
    """Return the Jacobian ``(3, 3)`` of the motion (x, y, theta) of one point of a rigid body by that of another one.

    The first is offset from the other by `x`, `y` [m].
    """
    return np.array([[1.0, 0.0, -y], [0.0, 1.0, x], [0.0, 0.0, 1.0]])


def turned(const double[:, :] matrix, double theta):
    """Return R M R': a covariance or information ``(3, 3)`` over (x, y, theta) with axes rotated by `theta` [rad]."""
    cdef double[:, ::1] result = np.empty((DOF, DOF))
    cdef Py_ssize_t i, j
    for i in range(3):
        for j in range(3):
            result[i, j] = matrix[i, j]
    turn(&result[0, 0], theta)
    return np.asarray(result)


def unit_complex(angles):
    """Return ``exp(1j * angles)``, shaped as the angles [rad]."""
    return np.exp(1j * angles)


def rotated(numbers, angles):
    """Rotate complex numbers by angles [rad] of a shape that fits theirs.

    numpy rounds products of complex arrays, and their absolute values, by the instructions of the processor: not these.
    """
    c, s = np.cos(angles), np.sin(angles)
    return (c * numbers.real - s * numbers.imag) + 1j * (s * numbers.real + c * numbers.imag)


def moduli(numbers):
    """Return the absolute values of complex numbers, the same on all processors."""
    return np.sqrt(numbers.real * numbers.real + numbers.imag * numbers.imag)


def as_complex(vectors):
    """Return vectors ``(P, 2)`` of any unit as complex numbers ``(P,)``."""
    return np.ascontiguousarray(vectors, dtype=float).view(complex)[:, 0]


def as_vectors(numbers):
    """Return complex numbers ``(P,)`` of any unit as vectors ``(P, 2)``."""
    return np.ascontiguousarray(numbers).view(float).reshape(-1, 2)


cdef class SE2:
    """A pose or a rigid motion ``p -> Rot(theta) p + (x, y)``.

    Attributes
    ----------
    x, y : float
        Translation [m].
    theta : float
        Rotation [rad], counter-clockwise.

    Raises
    ------
    ArgumentError
        When a number is not finite.
    """

    __match_args__ = 'x', 'y', 'theta'
    # Else an array would take a motion on its right as the array of its numbers, and multiply it by them.
    __array_ufunc__ = None

    def __init__(self, double x=0.0, double y=0.0, double theta=0.0):
        if not (isfinite(x) and isfinite(y) and isfinite(theta)):
            raise ArgumentError(f'SE2({x}, {y}, {theta}): expected finite numbers [m, m, rad]')
        self.x, self.y, self.theta = x, y, theta

    def __iter__(self):
        """Iterate over x [m], y [m] and theta [rad]."""
        return iter(self.as_tuple())

    def __array__(self, dtype=None, copy=None):
        """Convert to an array, as `as_array`."""
        return np.array(self.as_tuple(), dtype=dtype)

    def __matmul__(SE2 self, SE2 other):
        """Compose two motions: `other` is applied first, then this one."""
        cdef double c = cos(self.theta), s = sin(self.theta)
        return motion(self.x + c * other.x - s * other.y, self.y + s * other.x + c * other.y,
                      wrapped_angle(self.theta + other.theta))

    cpdef SE2 inverse(self):
        """Return the motion that undoes this one."""
        cdef double c = cos(self.theta), s = sin(self.theta)
        return motion(-c * self.x - s * self.y, s * self.x - c * self.y, wrapped_angle(-self.theta))

    def apply(self, points):
        """Transform points ``(..., 2)`` [m] by this motion."""
        points = np.asarray(points, dtype=float)
        c, s = cos(self.theta), sin(self.theta)
        x, y = points[..., 0], points[..., 1]
        return np.stack((c * x - s * y + self.x, s * x + c * y + self.y), axis=-1)

    def rotation(self):
        """Return the ``(2, 2)`` rotation matrix."""
        c, s = cos(self.theta), sin(self.theta)
        return np.array([[c, -s], [s, c]])

    def adjoint(self):
        """Return the ``(3, 3)`` adjoint Ad, which maps perturbations in the body frame to the frame before this motion.

        ``(a @ b)`` has the body covariance ``Ad(b^-1) Ca Ad(b^-1)' + Cb``.
        """
        c, s = cos(self.theta), sin(self.theta)
        return np.array([[c, -s, self.y], [s, c, -self.x], [0.0, 0.0, 1.0]])

    def brief(self):
        """Format the motion, rounded to 0.1 mm and 0.001 deg."""
        return f'x {fixed(self.x, 4)} m, y {fixed(self.y, 4)} m, theta {fixed(math.degrees(self.theta), 3)} deg'

    def as_tuple(self):
        """Return x [m], y [m] and theta [rad]."""
        return self.x, self.y, self.theta

    def as_array(self):
        """Return x [m], y [m] and theta [rad] as an array ``(3,)``."""
        return np.array([self.x, self.y, self.theta])

    @classmethod
    def from_array(cls, values):
        """Make a motion from x [m], y [m] and theta [rad]; the angle is wrapped."""
        x, y, theta = values
        return SE2(x, y, wrapped_angle(theta))

    def as_matrix(self):
        """Return the homogeneous matrix ``(3, 3)``, which transforms (x, y, 1)."""
        c, s = cos(self.theta), sin(self.theta)
        return np.array([[c, -s, self.x], [s, c, self.y], [0.0, 0.0, 1.0]])

    @classmethod
    def from_matrix(cls, matrix):
        """Make a motion from its homogeneous matrix ``(3, 3)``.

        Raises
        ------
        ArgumentError
            When the matrix is none of a rotation and a translation.
        """
        matrix = np.asarray(matrix, dtype=float)
        if matrix.shape != (DOF, DOF):
            raise ArgumentError(f'a matrix of shape {matrix.shape}: expected (3, 3)')
        made = SE2(matrix[0, 2], matrix[1, 2], atan2(matrix[1, 0], matrix[0, 0]))
        error = np.abs(made.as_matrix() - matrix).max()
        if not error <= ROUGH:
            raise ArgumentError(f'the matrix is {error:.2g} away from that of a rotation and a translation: expected '
                                '[[cos, -sin, x], [sin, cos, y], [0, 0, 1]]')
        return made

    def __repr__(self):
        return f'SE2(x={self.x!r}, y={self.y!r}, theta={self.theta!r})'

    def __eq__(self, other):
        if not isinstance(other, SE2):
            return NotImplemented
        return self.as_tuple() == other.as_tuple()

    def __hash__(self):
        return hash(self.as_tuple())

    def __reduce__(self):
        return SE2, self.as_tuple()
