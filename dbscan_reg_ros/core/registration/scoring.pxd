# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Scores of hypotheses, and which of them differ (section 2.3)."""
from libc.math cimport fabs

from ..features.oriented_points cimport OrientedPoints
from ..geometry.plane cimport bin_of, length_of, wrap
from .point_to_line cimport Hypotheses
from .views cimport Lines


cdef inline double violation(const double[::1] near, double x, double y, double tolerance) except? -1.0 nogil:
    """Return 1 for a point well in front of what a scan saw, falling to 0 within the tolerance [m]."""
    return min(max((near[bin_of(x, y, near.shape[0])] - length_of(x, y) - tolerance) * (1.0 / tolerance), 0.0), 1.0)


cdef inline bint are_near(double x, double y, double theta, double most_apart, double angle) noexcept nogil:
    """Whether a difference of two motions is at most a distance [m] and an angle [rad]."""
    return length_of(x, y) <= most_apart and fabs(wrap(theta)) <= angle


cdef class Comparison:
    cdef object problem
    cdef Lines field
    cdef OrientedPoints own
    cdef const double[::1] share, near
    cdef double min_cosine, damping, score_scale, tolerance, against


cdef int write_scores(Comparison comparison, Hypotheses found) except -1 nogil
cdef int write_reverse_conflicts(Comparison comparison, Hypotheses found, double[::1] fraction) except -1
cdef Py_ssize_t choose_distinct(Hypotheses found, Py_ssize_t most, double most_apart, double angle,
                                Py_ssize_t[::1] flag, Py_ssize_t[::1] chosen) except -1
cdef search_along(Comparison comparison, candidates, const double[::1] angles)
