# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
"""Correspondences of a scan's points with lines of the reference at one pose."""
from ..features.oriented_points cimport OrientedPoints
from .point_to_line cimport Hypothesis
from .uncertainty cimport ROWS
from .views cimport Lines


cdef enum:
    # Further rows of the table of a `Fit`: points [m], rotated; 1 where the normals agree; kernels of the errors.
    ROTATED_X = ROWS, ROTATED_Y, ALIKE, KERNEL, FIT_ROWS


cdef struct Agreement:
    # Sums over points: products of the components of both normals along a direction, and mean squares of the two.
    double shared, seen


cdef class Fit:
    cdef OrientedPoints points
    # Position [m] at which the points were looked up.
    cdef double x, y
    cdef double[:, ::1] table

    cpdef Fit of_every(self, Py_ssize_t step, OrientedPoints points)
    cdef void weigh(self, double scale) noexcept nogil
    cdef void derive_by_own(self, double theta) noexcept nogil
    cdef Agreement agreement(self, double angle, double scale) noexcept nogil


cdef Fit fit_at(Hypothesis *at, OrientedPoints points, Lines lines)
