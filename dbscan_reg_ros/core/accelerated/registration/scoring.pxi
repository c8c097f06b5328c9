# SPDX-License-Identifier: Apache-2.0
"""Scores of hypotheses (section 2.3), as `core.registration.scoring`."""


cdef inline double violation(const double[::1] near, double x, double y, double tolerance) except? -1.0 nogil:
    """Return 1 for a point well in front of what a scan saw, falling to 0 within the tolerance [m]."""
    return min(max((near[bin_of(x, y, near.shape[0])] - length_of(x, y) - tolerance) * (1.0 / tolerance), 0.0), 1.0)


cdef near_flags(candidates, double x, double y, double theta, double most_apart, double angle, bint inverted):
    """Return which hypotheses ``(H, 3)`` lie within a distance [m] and an angle [rad] of one; or which do not."""
    cdef const double[:, :] poses = candidates
    flags = np.empty(poses.shape[0], dtype=bool)
    cdef unsigned char[::1] flag = flags
    cdef Py_ssize_t h
    for h in range(poses.shape[0]):
        flag[h] = inverted ^ (length_of(poses[h, 0] - x, poses[h, 1] - y) <= most_apart
                              and fabs(wrap(poses[h, 2] - theta)) <= angle)
    return flags


def within_gate(candidates, prior, parameters):
    """Whether each hypothesis ``(H, 3)`` lies within `prior.gate` standard deviations of a prior."""
    expected, gate = prior.transform, parameters.gate
    return near_flags(candidates, expected.x, expected.y, expected.theta, gate * prior.translation_sigma,
                      gate * prior.rotation_sigma, False)


def find_rivals(const double[:, :] candidates, direction, parameters):
    """Return which hypotheses ``(H, 3)`` differ from the first by `decision.rival_distance` or `decision.rival_angle`.

    Differences along a degenerate `direction` [rad] do not count.
    """
    cdef double x = candidates[0, 0], y = candidates[0, 1], c, s, off
    cdef Py_ssize_t h
    cdef double[:, ::1] level
    if direction is None:
        return near_flags(candidates, x, y, candidates[0, 2], parameters.rival_distance, parameters.rival_angle, True)
    level, c, s = np.array(candidates), cos(direction), sin(direction)
    for h in range(level.shape[0]):
        off = (level[h, 0] - x) * c + (level[h, 1] - y) * s
        level[h, 0], level[h, 1] = level[h, 0] - off * c, level[h, 1] - off * s
    return near_flags(level, x, y, candidates[0, 2], parameters.rival_distance, parameters.rival_angle, True)
