# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Symmetric matrices ``(3, 3)``."""
from libc.math cimport M_PI, atan2, cos, sin

from .plane cimport length_of


cdef enum:
    # The inverse of `tolerance.TINY`.
    INVERSE_TINY = 1_000_000_000


cdef struct Factors:
    # Of a symmetric matrix (3, 3) as L D L': the diagonal of D, and L below its own by rows.
    double a, b, c, p, q, r


cdef inline Factors factors(double xx, double xy, double xt, double yy, double yt, double tt) noexcept nogil:
    """Factorise the symmetric matrix with this upper triangle."""
    cdef double p = xy / xx, q = xt / xx, b = yy - p * xy, rest = yt - p * xt, r = rest / b
    return Factors(xx, b, tt - q * xt - r * rest, p, q, r)


cdef inline double squared_distance(const double[:, :] covariance, double *error) except? -1.0 nogil:
    """Return the squared Mahalanobis distance of an error from 0."""
    cdef Factors f = factors(covariance[0, 0], covariance[0, 1], covariance[0, 2], covariance[1, 1], covariance[1, 2],
                             covariance[2, 2])
    cdef double y = error[1] - f.p * error[0], t = error[2] - f.q * error[0] - f.r * y
    return error[0] * error[0] / f.a + y * y / f.b + t * t / f.c


cdef struct Symmetric:
    # Upper triangle of a symmetric matrix (3, 3).
    double xx, xy, xt, yy, yt, tt


cdef inline Symmetric symmetric(const double[:, :] matrix) except *:
    """Return the upper triangle of a matrix."""
    return Symmetric(matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 1], matrix[1, 2], matrix[2, 2])


cdef inline void write_rows(Symmetric *m, double *rows) noexcept nogil:
    """Write a symmetric matrix as its rows."""
    rows[0], rows[1], rows[2] = m.xx, m.xy, m.xt
    rows[3], rows[4], rows[5] = m.xy, m.yy, m.yt
    rows[6], rows[7], rows[8] = m.xt, m.yt, m.tt


cdef inline Symmetric inverse_of(Symmetric *m) noexcept nogil:
    """Invert a symmetric matrix."""
    cdef Factors f = factors(m.xx, m.xy, m.xt, m.yy, m.yt, m.tt)
    cdef double tt = 1.0 / f.c, yt = -f.r * tt, yy = 1.0 / f.b - f.r * yt, xt = -f.p * yt - f.q * tt
    cdef double xy = -f.p * yy - f.q * yt
    return Symmetric(1.0 / f.a - f.p * xy - f.q * xt, xy, xt, yy, yt, tt)


cdef inline void turn(double *matrix, double theta) noexcept nogil:
    """Rotate the axes of a covariance or information (3, 3) over (x, y, theta) by `theta` [rad]: R M R'."""
    cdef double c = cos(theta), s = sin(theta), first
    cdef Py_ssize_t k
    for k in range(3):
        first = matrix[k]
        matrix[k], matrix[3 + k] = c * first - s * matrix[3 + k], s * first + c * matrix[3 + k]
    for k in range(3):
        first = matrix[3 * k]
        matrix[3 * k], matrix[3 * k + 1] = c * first - s * matrix[3 * k + 1], s * first + c * matrix[3 * k + 1]


cdef struct Weakest:
    # Direction [rad] in which the translation is constrained least, and the information along it and across it.
    double angle, weak, strong


cdef inline Weakest weakest_direction(double xx, double xy, double x, double yy, double y, double rotation) noexcept nogil:
    """Find the direction in which a match constrains the translation least, for an unknown rotation."""
    cdef double half, root
    rotation = max(rotation, 1.0 / <double> INVERSE_TINY)
    xx, xy, yy = xx - x * x / rotation, xy - x * y / rotation, yy - y * y / rotation
    half, root = 0.5 * (xx + yy), length_of(0.5 * (xx - yy), xy)
    return Weakest(0.5 * atan2(2.0 * xy, xx - yy) + 0.5 * M_PI, max(half - root, 0.0), half + root)


cdef inline Weakest weakest_of(Symmetric *information) noexcept nogil:
    """Find the `weakest_direction` of an information matrix."""
    return weakest_direction(information.xx, information.xy, information.xt, information.yy, information.yt,
                             information.tt)
