# SPDX-License-Identifier: Apache-2.0
"""Free-space profile of a scan, as `core.features.free_space`."""


cdef inline double rough_arctangent(double x, double y) noexcept nogil:
    """Return the bearing of a point [rad] to 1e-5; not a number where the point is the sensor's or infinite.

    Abramowitz and Stegun, "Handbook of Mathematical Functions", 4.4.47.
    """
    cdef double across = fabs(x), up = fabs(y), ratio = min(across, up) / max(across, up), s = ratio * ratio
    cdef double angle = ratio * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351))))
    angle = 0.5 * M_PI - angle if up > across else angle
    angle = M_PI - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


cdef inline Py_ssize_t bin_of(double x, double y, Py_ssize_t size) noexcept nogil:
    """Return which of `size` bins of the full circle a point lies in: near an edge by the exact bearing."""
    cdef double place = (rough_arctangent(x, y) + M_PI) * (size / (2.0 * M_PI)), rest = place - floor(place)
    if rest > 1e-5 * size and rest < 1.0 - 1e-5 * size:
        return <Py_ssize_t> place
    return min(<Py_ssize_t> ((atan2(y, x) + M_PI) * (size / (2.0 * M_PI))), size - 1)


def build_free_space_profile(const double[:, ::1] points, double increment):
    """Build the `FreeSpaceProfile` of a scan.

    A bin has information when the beams next to both of its edges have a return, at most three increments apart.

    Parameters
    ----------
    points : (P, 2) float
        Filtered points in the frame of the sensor [m].
    increment : float
        Step from one beam to the next [rad].
    """
    cdef Py_ssize_t count = points.shape[0], k, b, before, after, next_before, next_after
    cdef Py_ssize_t size = min(max(round(2.0 * math.pi / abs(increment)), free_space_steps._MIN_BINS),
                               free_space_steps._MAX_BINS)
    # By numpy: beams may lie on the edges of bins, where the last bit of another arctangent would decide.
    cdef const double[::1] angle = np.arctan2(points[:, 1], points[:, 0])
    cdef double[::1] radius = np.empty(count + 2), bearing = np.empty(count + 2)
    cdef Py_ssize_t[::1] order = np.empty(count, np.intp), scratch = np.empty(count, np.intp)
    cdef const double[::1] edges = free_space_steps._edges(size)
    cdef double widest = 3.0 * max(fabs(increment), 2.0 * M_PI / size), low, high
    profile = np.zeros((2, size))
    cdef double[:, ::1] limits = profile
    if not count:
        raise IndexError('a scan without points')
    with nogil:
        sort_stably(angle, order, scratch)
        for k in range(count):
            bearing[k + 1], radius[k + 1] = angle[order[k]], length_of(points[order[k], 0], points[order[k], 1])
        bearing[0], radius[0] = bearing[count] - 2.0 * M_PI, radius[count]
        bearing[count + 1], radius[count + 1] = bearing[1] + 2.0 * M_PI, radius[1]
        before = bisect_right(bearing, count + 2, edges[0]) - 1
        for b in range(size):
            next_before = before
            while next_before + 1 < count + 2 and bearing[next_before + 1] <= edges[b + 1]:
                next_before += 1
            next_after = next_before + (bearing[next_before] < edges[b + 1])
            if bearing[next_after] - bearing[before] < widest:
                low = high = radius[next_after]
                for k in range(before, next_before + 1):
                    low, high = min(low, radius[k]), max(high, radius[k])
                limits[0, b], limits[1, b] = low, high
            before = next_before
    return FreeSpaceProfile(profile[0], profile[1])
