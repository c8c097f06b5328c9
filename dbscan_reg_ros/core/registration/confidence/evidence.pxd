# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
"""Evidence for and against motions."""
from ...features.oriented_points cimport OrientedPoints
from ..fit cimport Fit
from ..point_to_line cimport Hypothesis
from ..views cimport SegmentViews


cdef struct Findings:
    # The numbers of `Evidence`.
    double conflicts_current, conflicts_reference
    int on_outline, matched_ends, unmatched_ends
    double crossing, residual, distance, weak, chance


cdef class Scene:
    # What one of the two scans saw: its sampled points, fixed ends and segments, and its free-space profile [m].
    cdef OrientedPoints points
    cdef const double complex[::1] ends
    cdef SegmentViews segments
    cdef const double[::1] near, far
    cdef double isolated


cdef int collect(Scene reference, Scene current, Fit found, Hypothesis *at, double weak, double tolerance,
                 Findings *evidence) except -1
cdef double odds_of(Findings *evidence) noexcept nogil
cdef double prior_gain(prior, Hypothesis *at) except? -1.0
