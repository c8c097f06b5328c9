# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Rotation hypotheses (section 2.2.1, Eq. 9)."""
from ..views cimport SegmentViews


cdef class RotationClusters:
    # Of the pairs, row by row: angle difference and cluster. Of the clusters, heaviest first: mean and weight.
    cdef double[::1] difference, phi, weight
    cdef Py_ssize_t[::1] labels
    cdef double eps


cdef double[::1] weights_of(SegmentViews reference, SegmentViews current, parameters)
cdef RotationClusters cluster_rotations(SegmentViews reference, SegmentViews current, const double[::1] weights,
                                        parameters)
