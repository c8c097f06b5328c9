# SPDX-License-Identifier: Apache-2.0
"""Noise of the ranges of a scan, as `core.features.range_noise`."""


def estimate_noise(const double[::1] ranges, limits):
    """Estimate the standard deviation of a range [m] from second differences along the scan.

    Parameters
    ----------
    ranges : (P,) float
        Returns in beam order [m].
    limits : ScanParameters
    """
    cdef Py_ssize_t size = ranges.shape[0] - 2, k
    if size + 2 < range_noise_steps._MIN_RANGES:
        return limits.noise_max
    cdef double[::1] bend = np.empty(size)
    cdef Py_ssize_t rank = int(range_noise_steps._NOISE_QUANTILE * size)
    cdef double found
    with nogil:
        for k in range(size):
            bend[k] = fabs(ranges[k + 1] - 0.5 * (ranges[k + 2] + ranges[k]))
        found = order_statistic(bend, size, rank)
    return min(max(found / (range_noise_steps._NORMAL * sqrt(1.5)), limits.noise_min), limits.noise_max)


def estimate_noise_ratio(const double complex[::1] points, const double[::1] ranges, const Py_ssize_t[::1] beams,
                         limits):
    """Estimate the standard deviation of a range as a fraction of the range.

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
    errors, radii = np.empty(points.shape[0]), np.empty(points.shape[0])
    cdef Py_ssize_t size = errors_along_beams(points, ranges, beams, errors, radii), half = size // 2, k
    if half < range_noise_steps._MIN_RANGES:
        return 0.0
    cdef double quantile = range_noise_steps._NOISE_QUANTILE
    cdef double[::1] error = errors, radius = radii, near = np.empty(half), far = np.empty(half)
    cdef Py_ssize_t[::1] order = np.empty(size, np.intp), scratch = np.empty(size, np.intp)
    cdef double near_noise, far_noise, far_high, near_range, far_range
    with nogil:
        sort_stably(radius[:size], order, scratch)
        for k in range(half):
            near[k], far[k] = error[order[k]], error[order[size - half + k]]
        near_range, far_range = radius[order[half // 2]], radius[order[size - half + half // 2]]
        near_noise = order_statistic(near, half, <Py_ssize_t> (quantile * half))
        far_noise = order_statistic(far, half, <Py_ssize_t> (quantile * half))
        far_high = order_statistic(far, half, <Py_ssize_t> ((1.0 - quantile) * half))
    if far_noise * far_noise * near_range <= near_noise * near_noise * far_range:
        return 0.0
    if far_high > range_noise_steps._MAX_SPREAD * far_noise:
        return 0.0
    return min(far_noise / far_range / range_noise_steps._NORMAL, limits.noise_ratio_max)


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
