# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Noise of the ranges of a scan, and how it grows with the range."""
import numpy as np

from libc.math cimport fabs, sqrt
from libc.string cimport memcpy

from ..geometry.ordering cimport order_statistic
from ..geometry.plane cimport length_of

cdef Py_ssize_t MIN_RANGES = 8
# Quantile of the errors that gives the noise, and that of |N(0, 1)|.
cdef double QUANTILE = 0.3, NORMAL = 0.38532
# Errors are no noise if their quantile 0.7 exceeds this multiple of their quantile 0.3 (2.7 for |N(0, 1)|).
cdef double MAX_SPREAD = 4.0
# Noise by the range [m] above which a point is noisier than the scan.
cdef double TYPICAL = 0.05


def estimate_noise(const double[::1] ranges, limits):
    """Estimate the standard deviation of a range [m] from second differences along the scan.

    A low quantile of the differences is robust against corners, range jumps and a good part of outliers. The result is
    clipped to the limits `noise_min` and `noise_max`.

    Parameters
    ----------
    ranges : (P,) float
        Returns in beam order [m].
    limits : ScanParameters
    """
    cdef double[::1] work = np.empty(ranges.shape[0] + 1)
    return noise_of(&ranges[0] if ranges.shape[0] else NULL, ranges.shape[0], limits, &work[0])


cdef double noise_of(const double *radius, Py_ssize_t size, limits, double *bend) except -1.0:
    """Return the `estimate_noise` of ranges; `bend` has room for as many numbers."""
    cdef Py_ssize_t count = size - 2, k
    cdef double found
    if size < MIN_RANGES:
        return limits.noise_max
    for k in range(count):
        bend[k] = fabs(radius[k + 1] - 0.5 * (radius[k + 2] + radius[k]))
    found = order_statistic(bend, count, <Py_ssize_t> (QUANTILE * count))
    return min(max(found / (NORMAL * sqrt(1.5)), limits.noise_min), limits.noise_max)


def estimate_noise_ratio(const double complex[::1] points, const double[::1] ranges, limits):
    """Estimate the standard deviation of a range as a fraction of the range.

    The error of a point is its distance, along its beam, from the line through its two neighbours; this holds for
    straight walls at any angle and for uneven beams. The errors of the nearer and of the farther half of the points are
    compared: the noise is taken as proportional to the range or as constant, whichever fits better. Errors that spread
    more widely than noise come from clutter and outliers; the result is then 0.

    Parameters
    ----------
    points : (N,) complex
        Point of each beam [m]; nan without a return.
    ranges : (N,) float
        Their ranges [m]. Many of a lidar are equal: computed again from the points, rounding would decide their order.
    limits : ScanParameters

    Returns
    -------
    float
        At most `noise_ratio_max`; 0 where far ranges are not noisier than near ones.
    """
    cdef Py_ssize_t size = points.shape[0], k
    cdef double[:, ::1] place = np.empty((3, size + 1))
    for k in range(size):
        place[0, k], place[1, k], place[2, k] = points[k].real, points[k].imag, ranges[k]
    return noise_ratio_of(&place[0, 0], &place[1, 0], &place[2, 0], size, limits)


cdef double noise_ratio_of(const double *x, const double *y, const double *ranges, Py_ssize_t size,
                           limits) except -1.0:
    """Return the `estimate_noise_ratio` of points x, y [m]."""
    cdef double[:, ::1] work = np.empty((4, size + 1))
    cdef double *error = &work[0, 0]
    cdef double *radius = &work[1, 0]
    cdef double *ranked = &work[2, 0]
    cdef double *part = &work[3, 0]
    cdef Py_ssize_t half, rest = 0, k
    cdef double near_noise, far_noise, far_high, near_range, far_range, last, first
    errors_along_beams(x, y, ranges, size, error)
    for k in range(size - 2):
        error[rest], radius[rest] = error[k], ranges[k + 1]
        rest += error[k] >= 0.0
    half = rest // 2
    rest -= half
    if half < MIN_RANGES:
        return 0.0
    memcpy(ranked, radius, (half + rest) * sizeof(double))
    # The nearer half of the ranges, the farther half and the one that may lie between.
    last = order_statistic(ranked, half + rest, half - 1)
    near_range = order_statistic(ranked, half, half // 2)
    first = order_statistic(ranked + half, rest, rest - half)
    far_range = order_statistic(ranked + rest, half, half // 2)
    take_nearest(radius, error, half + rest, last, half, part)
    near_noise = order_statistic(part, half, <Py_ssize_t> (QUANTILE * half))
    take_farthest(radius, error, half + rest, first, half, part)
    far_noise = order_statistic(part, half, <Py_ssize_t> (QUANTILE * half))
    far_high = order_statistic(part, half, <Py_ssize_t> ((1.0 - QUANTILE) * half))
    if far_noise * far_noise * near_range <= near_noise * near_noise * far_range:
        return 0.0
    if far_high > MAX_SPREAD * far_noise:
        return 0.0
    return min(far_noise / far_range / NORMAL, limits.noise_ratio_max)


cdef void errors_along_beams(const double *x, const double *y, const double *radius, Py_ssize_t size,
                             double *error) noexcept nogil:
    """Write the distance of each inner point from the line through its neighbours, scaled to equal noise.

    It is negative where the point does not lie between its neighbours, as seen from the sensor, or one has no return.
    """
    cdef Py_ssize_t k
    cdef double first, second, whole, off
    for k in range(size - 2):
        # Twice the areas of the triangles between the sensor and two points: for points on a line both pairs add up.
        first = x[k] * y[k + 1] - y[k] * x[k + 1]
        second = x[k + 1] * y[k + 2] - y[k + 1] * x[k + 2]
        whole = x[k] * y[k + 2] - y[k] * x[k + 2]
        off = (radius[k + 1] * radius[k + 1] * fabs(whole - first - second)
               / length_of(whole * radius[k + 1], length_of(second * radius[k], first * radius[k + 2])))
        error[k] = off if first * second > 0.0 else -1.0


cdef void take_nearest(const double *radius, const double *error, Py_ssize_t size, double last, Py_ssize_t count,
                       double *taken) noexcept nogil:
    """Write the errors of the `count` points with the least ranges, of those at the `last` range the first."""
    cdef Py_ssize_t k, equal = count, at = 0
    for k in range(size):
        equal -= radius[k] < last
    for k in range(size):
        taken[at] = error[k]
        at += (radius[k] < last) | ((radius[k] == last) & (equal > 0))
        equal -= radius[k] == last


cdef void take_farthest(const double *radius, const double *error, Py_ssize_t size, double first, Py_ssize_t count,
                        double *taken) noexcept nogil:
    """Write the errors of the `count` points with the largest ranges, of those at the `first` range the last."""
    cdef Py_ssize_t k, equal = count, at = 0
    for k in range(size):
        equal -= radius[k] > first
    for k in range(size - 1, -1, -1):
        taken[at] = error[k]
        at += (radius[k] > first) | ((radius[k] == first) & (equal > 0))
        equal -= radius[k] == first


def range_noise(const double[::1] radius, double noise, double ratio):
    """Return the standard deviation ``(P,)`` of each range [m].

    Parameters
    ----------
    radius : (P,) float
        Ranges [m].
    noise : float
        Standard deviation of a range of the scan [m].
    ratio : float
        Standard deviation of a range as a fraction of the range. Where ``ratio * radius`` exceeds `TYPICAL`, the
        excess is added to `noise`.
    """
    result = np.empty(radius.shape[0])
    cdef double[::1] each = result
    if radius.shape[0]:
        write_range_noise(&radius[0], radius.shape[0], noise, ratio, &each[0])
    return result


cdef void write_range_noise(const double *radius, Py_ssize_t size, double noise, double ratio,
                            double *result) noexcept nogil:
    """Write the `range_noise` of each range."""
    cdef Py_ssize_t k
    for k in range(size):
        result[k] = noise + max(ratio * radius[k] - TYPICAL, 0.0)
