# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
"""Pairs of a point of a scan and a line of a key frame."""
from ..registration.point_to_line cimport Equations


cdef enum:
    # Pairs are weighted this many at a time.
    LANES = 8


cdef struct Turned:
    # A point relative to the sensor [m] and its normal, rotated into the odometry frame; its inverse noise and weight.
    double x, y, nx, ny, inverse_noise, weight


cdef class Correspondences:
    cdef readonly object pose
    cdef readonly Py_ssize_t size
    cdef Py_ssize_t count, most
    cdef double *block
    # Index of the key frame and of the point of each pair.
    cdef int *of_frame
    cdef int *of_point
    # Derivatives of the error by x, y and theta, and the error [m], times the inverse noise of the point.
    cdef double *a
    cdef double *b
    cdef double *r
    cdef double *e
    # The given weight, and its product with the kernel of the error.
    cdef double *given
    cdef double *weight
    # Each point of the scan, and the sum of its kernels; step and scale for which the pairs have their weights.
    cdef Turned *turned
    cdef double *total
    cdef double[3] step
    cdef double scale

    cdef void end(self) noexcept nogil
    cdef void weigh(self, const double *step, double scale) noexcept nogil
    cdef void add(self, const double *step, double scale, Equations *sums) noexcept nogil
