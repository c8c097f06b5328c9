# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Surfaces of a scan: points in beam order, cut at breakpoints (Eq. 5), and their normals."""
import numpy as np

from libc.math cimport fabs

from ..geometry.plane cimport Line, cross, distance, fit_range, modulus


# Minimum number of points in the window of a point for it to have a normal.
cdef Py_ssize_t MIN_NEIGHBOURS = 3
# A point gets no normal if the neighbours' squared extents across and along the fitted line exceed this ratio.
cdef double MAX_RESIDUAL = 0.25


def find_breaks(const double complex[::1] points, const Py_ssize_t[::1] beams, double increment, double noise,
                parameters):
    """Find where neighbouring points lie too far apart for one surface (Eq. 5).

    Parameters
    ----------
    points : (P,) complex
        Returns in beam order [m].
    beams : (P,) int
        Beam of each point; the threshold grows with the number of beams between two points.
    increment : float
        Step from one beam to the next [rad].
    noise : float
        Standard deviation of a range [m].
    parameters : SegmentParameters

    Returns
    -------
    (P - 1,) bool
        True where a break lies between a point and the next.
    """
    breaks = np.empty(max(points.shape[0] - 1, 0), dtype=bool)
    cdef BreakLimits limits = break_limits(increment, noise, parameters)
    mark_breaks(points, beams, &limits, breaks)
    return breaks


cdef int mark_breaks(const double complex[::1] points, const Py_ssize_t[::1] beams, BreakLimits *limits,
                     unsigned char[::1] broken) except -1 nogil:
    """Mark the breaks between neighbouring points, as `find_breaks`."""
    cdef Py_ssize_t k
    for k in range(points.shape[0] - 1):
        broken[k] = is_break(points[k], points[k + 1], beams[k + 1] - beams[k], limits)
    return 0


cdef BreakLimits break_limits(double increment, double noise, parameters) except *:
    """Return the limits of Eq. 5."""
    return BreakLimits(parameters.breakpoint_factor * fabs(increment), parameters.breakpoint_noise * noise,
                       parameters.max_gap)


cdef bint is_break(double complex first, double complex second, Py_ssize_t gap, BreakLimits *limits) noexcept nogil:
    """Return whether two points, `gap` beams apart, lie on different surfaces (Eq. 5)."""
    return (gap > limits.max_gap or distance(second, first)
            >= limits.factor * gap * min(modulus(second), modulus(first)) + limits.margin)


cdef int sum_moments(const double complex[::1] points, double[:, ::1] total) except -1 nogil:
    """Write the sums ``(5, P + 1)`` of x, y, xx, xy, yy before each point [m, m^2]."""
    cdef Py_ssize_t k
    cdef double x, y
    total[:, 0] = 0.0
    for k in range(points.shape[0]):
        x, y = points[k].real, points[k].imag
        total[0, k + 1], total[1, k + 1] = total[0, k] + x, total[1, k] + y
        total[2, k + 1], total[3, k + 1] = total[2, k] + x * x, total[3, k] + x * y
        total[4, k + 1] = total[4, k] + y * y
    return 0


def estimate_normals(const double complex[::1] points, const unsigned char[::1] breaks, double increment,
                     const double[::1] noise, parameters):
    """Estimate unit normals from the neighbours of each point on its surface.

    Normals face the sensor; their side follows from the order of the beams. A point with fewer than three neighbours on
    its surface, or whose neighbours lie on no line, gets no normal. The window of a point spans `normal_reach`, or
    `normal_noise` times the noise where that is more, and at least `normal_beams` on each side: noise acts along the
    beams and tilts lines through points that lie close together.

    Parameters
    ----------
    points : (P,) complex
        Returns in beam order [m].
    breaks : (P - 1,) bool
        Result of `find_breaks`.
    increment : float
        Step from one beam to the next [rad].
    noise : (P,) float
        Standard deviation of each range [m].
    parameters : SegmentParameters

    Returns
    -------
    (P,) complex
        0 for points without a normal.
    """
    cdef double[:, ::1] moments = np.empty((5, points.shape[0] + 1))
    normals = np.empty(points.shape[0], complex)
    sum_moments(points, moments)
    fit_normals(points, breaks, moments, noise, increment, parameters, normals)
    return normals


cdef int fit_normals(const double complex[::1] points, const unsigned char[::1] breaks, const double[:, ::1] moments,
                     const double[::1] noise, double increment, parameters, double complex[::1] normals) except -1:
    """Write the normal of each point, as `estimate_normals`."""
    cdef Py_ssize_t size = points.shape[0], beams = parameters.normal_beams, k, first = 0, end = 0, low = 0, high = 0
    cdef Py_ssize_t begin, stop
    cdef double least = parameters.normal_reach, factor = parameters.normal_noise, reach
    cdef double[::1] path = np.zeros(size)
    cdef Line line
    if moments.shape[0] != 5 or moments.shape[1] != size + 1:
        raise IndexError('moments of another number of points')
    with nogil:
        measure_path(points, breaks, path)
        for k in range(size):
            if k == end:
                first, end = k, k + 1
                while end < size and not breaks[end - 1]:
                    end += 1
            reach = max(least, factor * noise[k])
            low = first_not_below(path, low, path[k] - reach)
            high = first_above(path, high, path[k] + reach)
            begin, stop = max(min(low, k - beams), first), min(max(high, k + beams + 1), end)
            normals[k] = 0.0
            if stop - begin < MIN_NEIGHBOURS:
                continue
            line = fit_range(moments, begin, stop)
            if line.residual > MAX_RESIDUAL * line.spread:
                continue
            normals[k] = -line.s + 1j * line.c
            if cross(points[stop - 1] - points[begin], normals[k]) * increment < 0.0:
                normals[k] = line.s - 1j * line.c
    return 0


cdef inline Py_ssize_t first_not_below(const double[::1] path, Py_ssize_t near, double limit) except -1 nogil:
    """Return the number of ascending values below a limit, which is about `near`."""
    while near < path.shape[0] and path[near] < limit:
        near += 1
    while near > 0 and path[near - 1] >= limit:
        near -= 1
    return near


cdef inline Py_ssize_t first_above(const double[::1] path, Py_ssize_t near, double limit) except -1 nogil:
    """Return the number of ascending values up to a limit, which is about `near`."""
    while near < path.shape[0] and path[near] <= limit:
        near += 1
    while near > 0 and path[near - 1] > limit:
        near -= 1
    return near


cdef int measure_path(const double complex[::1] points, const unsigned char[::1] breaks,
                      double[::1] path) except -1 nogil:
    """Write the distance along the surfaces up to each point [m], over three beams at a time where unbroken."""
    cdef Py_ssize_t k, size = points.shape[0]
    cdef double step
    for k in range(size - 1):
        step = 0.0
        if not breaks[k]:
            if 0 < k < size - 2 and not (breaks[k - 1] or breaks[k + 1]):
                step = distance(points[k + 2], points[k - 1]) / 3.0
            else:
                step = distance(points[k + 1], points[k])
        path[k + 1] = path[k] + step
    return 0
