# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Surfaces of a scan: points in beam order, cut at breakpoints (Eq. 5), and their normals."""
import numpy as np

from .oriented_points import PointSequence

from libc.math cimport fabs

from ..geometry.ordering cimport bisect_left, bisect_right
from ..geometry.plane cimport Line, cross, distance, fit_range, length_of, modulus


# Minimum number of points in the window of a point for it to have a normal.
cdef Py_ssize_t MIN_NEIGHBOURS = 3
# A point gets no normal if the neighbours' squared extents across and along the fitted line exceed this ratio.
cdef double MAX_RESIDUAL = 0.25


def point_sequence(const double complex[::1] points, const Py_ssize_t[::1] beams, double increment, double noise,
                   parameters):
    """Make the `PointSequence` of a scan: ranges, breaks (Eq. 5) and summed moments.

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
    """
    cdef Py_ssize_t size = points.shape[0], k
    cdef BreakLimits limits = break_limits(increment, noise, parameters)
    radii, moments, breaks = np.empty(size), np.zeros((5, size + 1)), np.empty(max(size - 1, 0), dtype=bool)
    cdef double[::1] radius = radii
    cdef double[:, ::1] total = moments
    cdef unsigned char[::1] broken = breaks
    cdef double x, y
    with nogil:
        for k in range(size):
            x, y = points[k].real, points[k].imag
            radius[k] = length_of(x, y)
            total[0, k + 1], total[1, k + 1] = total[0, k] + x, total[1, k] + y
            total[2, k + 1], total[3, k + 1] = total[2, k] + x * x, total[3, k] + x * y
            total[4, k + 1] = total[4, k] + y * y
        for k in range(size - 1):
            broken[k] = is_break(points[k], points[k + 1], beams[k + 1] - beams[k], &limits)
    return PointSequence(np.asarray(points), radii, np.asarray(beams), moments, breaks, increment)


def find_breaks(const double complex[::1] points, const Py_ssize_t[::1] beams, double increment, double noise,
                parameters):
    """Find where neighbouring points lie too far apart for one surface (Eq. 5); arguments as for `point_sequence`.

    Returns
    -------
    (P - 1,) bool
        True where a break lies between a point and the next.
    """
    cdef Py_ssize_t size = points.shape[0], k
    cdef BreakLimits limits = break_limits(increment, noise, parameters)
    breaks = np.empty(max(size - 1, 0), dtype=bool)
    cdef unsigned char[::1] broken = breaks
    for k in range(size - 1):
        broken[k] = is_break(points[k], points[k + 1], beams[k + 1] - beams[k], &limits)
    return breaks


cdef struct BreakLimits:
    # Distance beyond which two neighbouring beams are apart: per range, and by noise [m]; widest gap [beams].
    double factor, margin
    Py_ssize_t max_gap


cdef BreakLimits break_limits(double increment, double noise, parameters) except *:
    """Return the limits of Eq. 5."""
    return BreakLimits(parameters.breakpoint_factor * fabs(increment), parameters.breakpoint_noise * noise,
                       parameters.max_gap)


cdef inline bint is_break(double complex first, double complex second, Py_ssize_t gap,
                          BreakLimits *limits) noexcept nogil:
    """Return whether two points, `gap` beams apart, lie on different surfaces (Eq. 5)."""
    return (gap > limits.max_gap or distance(second, first)
            >= limits.factor * gap * min(modulus(second), modulus(first)) + limits.margin)


def estimate_normals(sequence, const double[::1] noise, parameters):
    """Estimate unit normals from the neighbours of each point on its surface.

    Normals face the sensor; their side follows from the order of the beams. A point with fewer than three neighbours on
    its surface, or whose neighbours lie on no line, gets no normal. The window of a point spans `normal_reach`, or
    `normal_noise` times the noise where that is more, and at least `normal_beams` on each side: noise acts along the
    beams and tilts lines through points that lie close together.

    Parameters
    ----------
    sequence : PointSequence
    noise : (P,) float
        Standard deviation of each range [m].
    parameters : SegmentParameters

    Returns
    -------
    (P,) complex
        0 for points without a normal.
    """
    cdef const double complex[::1] points = sequence.points
    cdef const double[:, ::1] moments = sequence.moments
    cdef const unsigned char[::1] breaks = sequence.breaks
    cdef Py_ssize_t size = points.shape[0], beams = parameters.normal_beams, k, low, high, first = 0, end = 0
    cdef double least = parameters.normal_reach, factor = parameters.normal_noise, increment = sequence.increment, reach
    found = np.zeros(size, complex)
    cdef double complex[::1] normals = found
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
            low = max(min(bisect_left(path, size, path[k] - reach), k - beams), first)
            high = min(max(bisect_right(path, size, path[k] + reach), k + beams + 1), end)
            if high - low < MIN_NEIGHBOURS:
                continue
            line = fit_range(moments, low, high)
            if line.residual > MAX_RESIDUAL * line.spread:
                continue
            normals[k] = -line.s + 1j * line.c
            if cross(points[high - 1] - points[low], normals[k]) * increment < 0.0:
                normals[k] = line.s - 1j * line.c
    return found


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
