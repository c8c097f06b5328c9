# SPDX-License-Identifier: Apache-2.0
"""Scores of hypotheses (section 2.3), as `core.registration.scoring`."""


cdef inline double violation(const double[::1] near, double x, double y, double tolerance) except? -1.0 nogil:
    """Return 1 for a point well in front of what a scan saw, falling to 0 within the tolerance [m]."""
    return min(max((near[bin_of(x, y, near.shape[0])] - length_of(x, y) - tolerance) * (1.0 / tolerance), 0.0), 1.0)


cdef inline bint is_near(const double[:, ::1] poses, Py_ssize_t h, double x, double y, double theta, double most_apart,
                         double angle) except -1 nogil:
    """Whether a hypothesis lies within a distance [m] and an angle [rad] of one."""
    return length_of(poses[h, 0] - x, poses[h, 1] - y) <= most_apart and fabs(wrap(poses[h, 2] - theta)) <= angle


def find_rivals(candidates, direction, parameters):
    """Return which hypotheses ``(H, 3)`` differ from the first by `decision.rival_distance` or `decision.rival_angle`.

    Differences along a degenerate `direction` [rad] do not count.
    """
    cdef double[:, ::1] poses = np.array(candidates)
    cdef Py_ssize_t h
    cdef double x = poses[0, 0], y = poses[0, 1], theta = poses[0, 2], c, s, off
    cdef double apart = parameters.rival_distance, angle = parameters.rival_angle
    flags = np.zeros(poses.shape[0], dtype=bool)
    cdef unsigned char[::1] flag = flags
    if direction is not None:
        c, s = cos(direction), sin(direction)
        for h in range(poses.shape[0]):
            off = (poses[h, 0] - x) * c + (poses[h, 1] - y) * s
            poses[h, 0], poses[h, 1] = poses[h, 0] - off * c, poses[h, 1] - off * s
    for h in range(poses.shape[0]):
        flag[h] = not is_near(poses, h, x, y, theta, apart, angle)
    return flags
