# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, binding=True, boundscheck=True, wraparound=False, cdivision=True
"""Symmetric positive definite 3 x 3 matrices as arrays."""
import numpy as np

from libc.math cimport fabs, isfinite, sqrt

from ..errors import ArgumentError
from .se2 import DOF
from .tolerance import TINY

from .symmetric cimport Factors, Symmetric, factors, inverse_of, squared_distance, symmetric, write_rows

IDENTITY = np.eye(DOF)
IDENTITY.flags.writeable = False
cdef double tiny = TINY


cdef Factors factors_of(const double[:, :] matrix) except *:
    """Return the factors of a matrix; raise `ZeroDivisionError` if it is singular."""
    cdef Factors f = factors(matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 1], matrix[1, 2], matrix[2, 2])
    if f.a == 0.0 or f.b == 0.0 or f.c == 0.0:
        raise ZeroDivisionError('the matrix is singular')
    return f


def as_covariance(matrix):
    """Return a covariance as an array ``(3, 3)``.

    Raises
    ------
    ArgumentError
        When the matrix is not symmetric and positive definite.
    """
    array = np.asarray(matrix, dtype=float)
    if array.ndim != 2 or array.shape[0] != DOF or array.shape[1] != DOF:
        raise ArgumentError(f'a covariance of shape {array.shape}: expected (3, 3), of x, y [m] and theta [rad]')
    cdef const double[:, :] rows = array
    cdef Factors f = factors(rows[0, 0], rows[0, 1], rows[0, 2], rows[1, 1], rows[1, 2], rows[2, 2])
    cdef Py_ssize_t i, j
    if not (f.a > 0.0 and f.b > 0.0 and f.c > 0.0 and isfinite(f.a + f.b + f.c)):
        raise ArgumentError(f'a covariance {array.tolist()}: expected a positive definite matrix; its diagonal holds '
                            'the squared standard deviations')
    for i in range(3):
        for j in range(i):
            if not fabs(rows[i, j] - rows[j, i]) <= tiny * sqrt(rows[i, i] * rows[j, j]):
                raise ArgumentError(f'a covariance {array.tolist()}: expected a symmetric matrix')
    return array


def inverse(const double[:, :] matrix):
    """Invert a ``(3, 3)`` matrix.

    Raises
    ------
    ZeroDivisionError
        When the matrix is singular.
    """
    cdef Symmetric upper = symmetric(matrix)
    result = np.empty((DOF, DOF))
    cdef double[:, ::1] rows = result
    factors_of(matrix)
    upper = inverse_of(&upper)
    write_rows(&upper, &rows[0, 0])
    return result


def corrected(const double[:, :] covariance, const double[:, :] information):
    """Combine a `covariance` P with independent `information` I, both ``(3, 3)`` in one frame.

    Returns
    -------
    covariance : (3, 3) array
        ``C = (P^-1 + I)^-1``.
    gain : (3, 3) array
        ``1 - C I``, the Kalman gain of what has the covariance P.
    """
    combined, gain = inverse(covariance), np.empty((DOF, DOF))
    cdef double[:, ::1] total = combined, weight = gain
    cdef Py_ssize_t i, j, k
    for i in range(3):
        for j in range(3):
            total[i, j] += information[i, j]
    combined = inverse(total)
    total = combined
    for i in range(3):
        for j in range(3):
            weight[i, j] = i == j
            for k in range(3):
                weight[i, j] -= total[i, k] * information[k, j]
    return combined, gain


def mahalanobis(error, const double[:, :] covariance):
    """Return the squared Mahalanobis distance from zero of an `error` ``(3,)`` with a `covariance` ``(3, 3)``."""
    cdef double[3] e
    e[0], e[1], e[2] = error
    factors_of(covariance)
    return squared_distance(covariance, e)


def diagonal(double x, double y, double t):
    """Return the ``(3, 3)`` matrix with these numbers on its diagonal."""
    result = np.zeros((DOF, DOF))
    cdef double[:, ::1] entry = result
    entry[0, 0], entry[1, 1], entry[2, 2] = x, y, t
    return result
