# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Rotation hypotheses (section 2.2.1, Eq. 9)."""
from ..views cimport SegmentViews


cdef class RotationClusters:
    cdef double[:, ::1] difference
    cdef Py_ssize_t[::1] labels
    cdef double[::1] phi, weight
    cdef double eps
    cdef int rank(self, const double[::1] samples, const double[::1] sample_weight, const Py_ssize_t[::1] labels,
                  double period, Py_ssize_t most) except -1


cdef weights_of(SegmentViews reference, SegmentViews current, parameters)
