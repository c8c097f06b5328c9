# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Oriented points of a scan, and the points that constrain a direction which few others do."""
import numpy as np

from ..geometry import tolerance
from .oriented_points import OrientedPoints, spacing

from libc.math cimport isfinite

from ..geometry.plane cimport length_of, rotated

cdef double TINY = tolerance.TINY


def finite_points(const double[:, :] place):
    """Return the finite points of a scan ``(P, 2)`` [m], also as complex numbers ``(P,)``, their ranges and beams."""
    cdef Py_ssize_t size = place.shape[0], k, count = 0
    points, radii, beams = np.empty((size, 2)), np.empty(size), np.empty(size, np.intp)
    cdef double[:, ::1] point = points
    cdef double[::1] radius = radii
    cdef Py_ssize_t[::1] beam = beams
    with nogil:
        for k in range(size):
            if isfinite(place[k, 0]):
                point[count, 0], point[count, 1], beam[count] = place[k, 0], place[k, 1], k
                radius[count] = length_of(place[k, 0], place[k, 1])
                count += 1
    points = points[:count]
    return points, points.view(complex)[:, 0], radii[:count], beams[:count]


def build_oriented_points(const double[:, :] points, const double[:, :] normals, const Py_ssize_t[:] beams):
    """Build `OrientedPoints` from points and normals ``(P, 2)``, leaving out points without a normal."""
    cdef Py_ssize_t size = points.shape[0], k, count = 0
    vectors, numbers = np.empty((2, size), complex), np.empty(size, np.intp)
    cdef double complex[:, ::1] vector = vectors
    cdef Py_ssize_t[::1] beam = numbers
    with nogil:
        for k in range(size):
            if normals[k, 0] != 0.0 or normals[k, 1] != 0.0:
                vector[0, count] = points[k, 0] + 1j * points[k, 1]
                vector[1, count] = normals[k, 0] + 1j * normals[k, 1]
                beam[count] = beams[k]
                count += 1
    return OrientedPoints(vectors[0, :count], vectors[1, :count], numbers[:count])


def leverage(oriented, double ridge):
    """Return weights ``(P,)`` with sum 1 that are larger for points with a rare normal direction.

    In a corridor this raises the weight of the few points whose normals point along it. The weight is the statistical
    leverage of the normal in a regression with this `ridge`; large values make all weights equal.
    """
    cdef const double complex[::1] normals = oriented.normals
    cdef Py_ssize_t size = normals.shape[0], k
    cdef const double[::1] given = given_or_ones(oriented.weights, size)
    cdef double xx = 0.0, xy = 0.0, yy = 0.0, x, y, total = 0.0
    weights = np.empty(size)
    cdef double[::1] weight = weights
    with nogil:
        for k in range(size):
            x, y = normals[k].real, normals[k].imag
            xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
        xx, xy, yy = xx / max(size, 1) + ridge, xy / max(size, 1), yy / max(size, 1) + ridge
        for k in range(size):
            x, y = normals[k].real, normals[k].imag
            weight[k] = (yy * x * x - 2.0 * xy * x * y + xx * y * y) * given[k]
            total += weight[k]
        for k in range(size):
            weight[k] /= max(total, TINY)
    return weights


def high_leverage(const double complex[::1] normals):
    """Find points with a rare normal direction: those with more than twice the mean leverage.

    The factor of two is the rule of thumb of Hoaglin and Welsch, "The hat matrix in regression and ANOVA", The American
    Statistician 32, 1978.

    Parameters
    ----------
    normals : (P,) complex
        Unit normals.

    Returns
    -------
    (P,) bool
    """
    cdef Py_ssize_t size = normals.shape[0], k
    cdef double x = 0.0, y = 0.0
    cdef double complex double_angle
    flags = np.empty(size, dtype=bool)
    cdef unsigned char[::1] rare = flags
    with nogil:
        # The double angle makes a direction and its opposite equal: the leverage is 2 (1 - c r) / (1 - r^2).
        for k in range(size):
            double_angle = rotated(normals[k], normals[k])
            x, y = x + double_angle.real, y + double_angle.imag
        x, y = x / max(size, 1), y / max(size, 1)
        for k in range(size):
            double_angle = rotated(normals[k], normals[k])
            rare[k] = double_angle.real * x + double_angle.imag * y < 2.0 * (x * x + y * y) - 1.0
    return flags


def sample(oriented, Py_ssize_t count):
    """Return at most `count` points, evenly spaced along the scan, and in addition all points of `high_leverage`."""
    if len(oriented) <= count:
        return oriented
    chosen = high_leverage(oriented.normals)
    chosen[::spacing(len(oriented), count)] = True
    return oriented.select(chosen.nonzero()[0])


cdef const double[::1] ones = np.ones(4096)


cdef const double[::1] given_or_ones(values, Py_ssize_t size):
    """Return the values of P points; where they are None as many ones."""
    if values is not None:
        return values
    return ones[:size] if size <= ones.shape[0] else np.ones(size)
