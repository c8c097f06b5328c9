# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
from ..geometry.plane cimport Moments

# Difference of two ranges [m], beyond the noise, from which a surface ends in front of another one: more than the depth
# of a door frame.
cdef double DEPTH_MARGIN


cdef struct BreakLimits:
    # Distance beyond which two neighbouring beams are apart: per range, and by noise [m]; widest gap [beams].
    double factor, margin
    Py_ssize_t max_gap


cdef struct NormalLimits:
    # Reach of a window [m], and at least this multiple of the noise; step of the beams [rad]; least beams on each side.
    double reach, noise_factor, increment
    Py_ssize_t beams


cdef struct Surfaces:
    # P points in beam order [m], their ranges, and the distance from each to the next [m].
    Py_ssize_t size
    double *x
    double *y
    double *radius
    double *step
    # Sums over the points before each one, and over all.
    Moments *moments
    # Room for one number a point.
    double *work
    # Beam of each point; whether it and the next lie on different surfaces.
    const Py_ssize_t *beam
    unsigned char *breaks


cdef inline bint is_break(double step, Py_ssize_t gap, double nearer, BreakLimits *limits) noexcept nogil:
    """Return whether points a `step` [m] and a `gap` [beams] apart, the nearer at that range, are apart (Eq. 5)."""
    return (gap > limits.max_gap) | (step >= limits.factor * gap * nearer + limits.margin)


cdef Surfaces surfaces_in(double *block, Py_ssize_t size) noexcept nogil
cdef Py_ssize_t room_of(Py_ssize_t size) noexcept nogil
cdef BreakLimits break_limits(double increment, double noise, parameters) except *
cdef NormalLimits normal_limits(double increment, parameters) except *
cdef void mark_breaks(Surfaces *surfaces, BreakLimits *limits) noexcept nogil
cdef void sum_moments(Surfaces *surfaces) noexcept nogil
cdef void fit_normals(const Surfaces *surfaces, const double *noise, NormalLimits *limits,
                      double *normals) noexcept nogil
