# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Scores of hypotheses, and which of them differ (section 2.3)."""
cimport cython
from libc.math cimport fabs

from ..features.free_space cimport PlacedPoints
from ..features.oriented_points cimport BLOCK, OrientedPoints
from ..geometry.plane cimport length_of, wrap
from .point_to_line cimport Hypotheses, Pose
from .views cimport Lines

# Hypotheses farther than this [m] or [rad] from the best are rivals: a robot there would notice it.
cdef double RIVAL_DISTANCE, RIVAL_ANGLE
# A point violates the free space of the other scan when it is farther than this [m] before the ranges measured there:
# farther than a surface seen at a grazing angle is from its neighbouring beams.
cdef double VIOLATION_TOLERANCE
# Number of points for the pre-selection and, without a prior, for the coarse refinement.
cdef Py_ssize_t PRESELECTION_POINTS


cdef inline bint are_near(double x, double y, double theta, double most_apart, double angle) noexcept nogil:
    """Whether a difference of two motions is at most a distance [m] and an angle [rad]."""
    return length_of(x, y) <= most_apart and fabs(wrap(theta)) <= angle


@cython.boundscheck(False)
cdef inline void place(OrientedPoints points, Py_ssize_t first, Pose *pose, PlacedPoints *seen) noexcept nogil:
    """Place a block of points of the current scan, from the `first`, in the frame of the reference (Eq. 8)."""
    cdef const double *point = <const double *> &points.points_view[first]
    cdef Pose at = pose[0]
    cdef Py_ssize_t size = min(BLOCK, points.size - first), k
    seen.size = size
    for k in range(size):
        seen.x[k] = at.c * point[2 * k] - at.s * point[2 * k + 1] + at.x
        seen.y[k] = at.s * point[2 * k] + at.c * point[2 * k + 1] + at.y


@cython.boundscheck(False)
cdef inline void place_back(OrientedPoints points, Py_ssize_t first, Pose *pose, PlacedPoints *seen) noexcept nogil:
    """Place a block of points of the reference, from the `first`, in the frame of the current scan."""
    cdef const double *point = <const double *> &points.points_view[first]
    cdef Pose at = pose[0]
    cdef Py_ssize_t size = min(BLOCK, points.size - first), k
    cdef double x, y
    seen.size = size
    for k in range(size):
        x, y = point[2 * k] - at.x, point[2 * k + 1] - at.y
        seen.x[k], seen.y[k] = at.c * x + at.s * y, at.c * y - at.s * x


cdef class Comparison:
    cdef object problem
    cdef Lines field
    # Sampled points of the current scan with their leverages; how far the reference saw, for each bin [m].
    cdef OrientedPoints points
    cdef const double[::1] leverage, free_space
    cdef double damping, score_scale, tolerance, violation_weight


cdef int write_scores(Comparison comparison, Hypotheses found) except -1 nogil
cdef int write_reverse_conflicts(Comparison comparison, Hypotheses found, double[::1] fraction) except -1
cdef Py_ssize_t choose_distinct(Hypotheses found, Py_ssize_t most, double most_apart, double angle,
                                Py_ssize_t[::1] flag, Py_ssize_t[::1] chosen) except -1
cdef search_along(Comparison comparison, candidates, const double[::1] angles)
