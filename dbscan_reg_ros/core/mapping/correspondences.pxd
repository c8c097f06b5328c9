# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
"""Pairs of a point of a scan and a line of a key frame."""
from ..registration.point_to_line cimport Equations


cdef struct Pair:
    # Index of the key frame and of the point.
    int frame, point
    # Derivatives of the error by x, y and theta, and the error [m], times the inverse noise of the point.
    double a, b, r, e
    # The point relative to the sensor, rotated into the odometry frame [m].
    double x, y
    # The given weight, and its product with the kernel of the error.
    double given, weight


cdef class Correspondences:
    cdef readonly object pose
    cdef readonly Py_ssize_t size
    cdef Pair *pairs
    cdef Py_ssize_t count
    # The sum of the kernels of each point; step and scale for which the pairs have their weights.
    cdef double *total
    cdef double[3] step
    cdef double scale

    cdef void weigh(self, const double *step, double scale) noexcept nogil
    cdef void add(self, const double *step, double scale, Equations *sums) noexcept nogil
