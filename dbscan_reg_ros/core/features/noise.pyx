# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Noise of the ranges of a scan, and how it grows with the range."""
import numpy as np

from libc.math cimport fabs, sqrt

from ..geometry.ordering cimport order_statistic
from ..geometry.plane cimport cross, length_of

cdef Py_ssize_t MIN_RANGES = 8
# Quantile of the errors that gives the noise, and that of |N(0, 1)|.
cdef double QUANTILE = 0.3, NORMAL = 0.38532
# Errors are no noise if their quantile 0.7 exceeds this multiple of their quantile 0.3 (2.7 for |N(0, 1)|).
cdef double MAX_SPREAD = 4.0
# Points whose range noise [m] exceeds this get a smaller weight.
cdef double TYPICAL = 0.05


cpdef double estimate_noise(const double[::1] ranges, limits) except -1.0:
    """Estimate the standard deviation of a range [m] from second differences along the scan.

    A low quantile of the differences is robust against corners, range jumps and a good part of outliers. The result is
    clipped to the limits `noise_min` and `noise_max`.

    Parameters
    ----------
    ranges : (P,) float
        Returns in beam order [m].
    limits : ScanParameters
    """
    cdef Py_ssize_t size = ranges.shape[0] - 2, k
    if size + 2 < MIN_RANGES:
        return limits.noise_max
    cdef double[::1] bend = np.empty(size)
    cdef Py_ssize_t rank = int(QUANTILE * size)
    cdef double found
    with nogil:
        for k in range(size):
            bend[k] = fabs(ranges[k + 1] - 0.5 * (ranges[k + 2] + ranges[k]))
        found = order_statistic(bend, size, rank)
    return min(max(found / (NORMAL * sqrt(1.5)), limits.noise_min), limits.noise_max)


cpdef double estimate_noise_ratio(const double complex[::1] points, const double[::1] ranges,
                                  const Py_ssize_t[::1] beams, limits) except -1.0:
    """Estimate the standard deviation of a range as a fraction of the range.

    The error of a point is its distance, along its beam, from the line through its two neighbours; this holds for
    straight walls at any angle and for uneven beams. The errors of the nearer and of the farther half of the points are
    compared: the noise is taken as proportional to the range or as constant, whichever fits better. Errors that spread
    more widely than noise come from clutter and outliers; the result is then 0.

    Parameters
    ----------
    points : (P,) complex
        Returns in beam order [m].
    ranges : (P,) float
        Their ranges [m]. Many of a lidar are equal: computed again from the points, rounding would decide their order.
    beams : (P,) int
        Beam of each point.
    limits : ScanParameters

    Returns
    -------
    float
        At most `noise_ratio_max`; 0 where far ranges are not noisier than near ones.
    """
    cdef double[:, ::1] work = np.empty((4, points.shape[0]))
    cdef double[::1] error = work[0], radius = work[1], ranked = work[2], part = work[3]
    cdef Py_ssize_t size = errors_along_beams(points, ranges, beams, error, radius), half = size // 2
    cdef double near_noise, far_noise, far_high, near_range, far_range
    if half < MIN_RANGES:
        return 0.0
    with nogil:
        ranked[:size] = radius[:size]
        near_range = order_statistic(ranked, size, half // 2)
        far_range = order_statistic(ranked, size, size - half + half // 2)
        take_nearest(radius[:size], error, order_statistic(ranked, size, half - 1), half, part)
        near_noise = order_statistic(part, half, <Py_ssize_t> (QUANTILE * half))
        take_farthest(radius[:size], error, order_statistic(ranked, size, size - half), half, part)
        far_noise = order_statistic(part, half, <Py_ssize_t> (QUANTILE * half))
        far_high = order_statistic(part, half, <Py_ssize_t> ((1.0 - QUANTILE) * half))
    if far_noise * far_noise * near_range <= near_noise * near_noise * far_range:
        return 0.0
    if far_high > MAX_SPREAD * far_noise:
        return 0.0
    return min(far_noise / far_range / NORMAL, limits.noise_ratio_max)


cdef int take_nearest(const double[::1] radius, const double[::1] error, double last, Py_ssize_t count,
                      double[::1] taken) except -1 nogil:
    """Write the errors of the `count` points with the least ranges, of those at the `last` range the first."""
    cdef Py_ssize_t k, nearer = 0, at = 0
    for k in range(radius.shape[0]):
        nearer += radius[k] < last
    for k in range(radius.shape[0]):
        if radius[k] < last or (radius[k] == last and nearer < count):
            nearer += radius[k] == last
            taken[at] = error[k]
            at += 1
    return 0


cdef int take_farthest(const double[::1] radius, const double[::1] error, double first, Py_ssize_t count,
                       double[::1] taken) except -1 nogil:
    """Write the errors of the `count` points with the largest ranges, of those at the `first` range the last."""
    cdef Py_ssize_t k, farther = 0, at = 0
    for k in range(radius.shape[0]):
        farther += radius[k] > first
    for k in range(radius.shape[0] - 1, -1, -1):
        if radius[k] > first or (radius[k] == first and farther < count):
            farther += radius[k] == first
            taken[at] = error[k]
            at += 1
    return 0


cdef Py_ssize_t errors_along_beams(const double complex[::1] points, const double[::1] ranges,
                                   const Py_ssize_t[::1] beams, double[::1] error, double[::1] radius) except -1 nogil:
    """Write distances from the lines through the neighbours, scaled to equal noise, and ranges; return their number."""
    cdef Py_ssize_t k, count = 0
    cdef double first, second, whole, before, middle, after
    for k in range(1, points.shape[0] - 1):
        # Twice the areas of the triangles between the sensor and two points: for points on a line both pairs add up.
        first, second = cross(points[k - 1], points[k]), cross(points[k], points[k + 1])
        if beams[k + 1] - 1 != beams[k - 1] + 1 or not first * second > 0.0:
            continue
        whole = cross(points[k - 1], points[k + 1])
        before, middle, after = ranges[k - 1], ranges[k], ranges[k + 1]
        error[count] = (middle * middle * fabs(whole - first - second)
                        / length_of(whole * middle, length_of(second * before, first * after)))
        radius[count] = middle
        count += 1
    return count


def range_noise(const double[::1] radius, double noise, double ratio):
    """Return the standard deviation ``(P,)`` of each range [m].

    Parameters
    ----------
    radius : (P,) float
        Ranges [m].
    noise : float
        Standard deviation of a range of the scan [m].
    ratio : float
        Standard deviation of a range as a fraction of the range. Where ``ratio * radius`` exceeds `TYPICAL_NOISE`, the
        excess is added to `noise`.
    """
    result = np.empty(radius.shape[0])
    write_range_noise(radius, noise, ratio, result)
    return result


cdef int write_range_noise(const double[::1] radius, double noise, double ratio, double[::1] result) except -1 nogil:
    """Write the `range_noise` of each range."""
    cdef Py_ssize_t k
    for k in range(radius.shape[0]):
        result[k] = noise + max(ratio * radius[k] - TYPICAL, 0.0)
    return 0
