# SPDX-License-Identifier: Apache-2.0
"""Search along the degenerate direction (corridors)."""


def search_degenerate_direction(candidates, angles, problem):
    """Shift each candidate along its degenerate direction to where the points with normals in this direction fit best.

    Parameters
    ----------
    candidates : (H, 3) array
    angles : (H,) array [rad]
        Degenerate direction of each candidate in the reference's frame.
    problem : Problem

    Returns
    -------
    (H, 3) array
    """
    return search_along(Comparison(problem), candidates, angles)


cdef search_along(Comparison comparison, candidates, const double[::1] angles):
    """Shift each candidate ``(H, 3)`` along its angle [rad] to the best fit, first coarsely, then finely."""
    p, last = comparison.problem.parameters, comparison.score_scale
    cdef PointViews views = comparison.own
    cdef double least = p.translation.min_crossing_sine, reach, step, scale
    cdef Py_ssize_t h, facing
    shifted = np.array(candidates)
    cdef double[:, ::1] poses = shifted
    cdef unsigned char[::1] faces = np.zeros(views.size, np.uint8)
    cdef double[::1] value
    with nogil:
        facing = flag_facing(views, poses, angles, least, faces)
    if facing < p.degeneracy.min_points:
        return shifted
    for reach, step, scale in (
            (p.degeneracy.search_distance, 2.0 * last, 3.0 * last), (2.5 * last, 0.4 * last, last)):
        value = np.empty(2 * math.floor(reach / step) + 1)
        for h in range(poses.shape[0]):
            with nogil:
                shift_along(comparison, views, faces, angles[h], step, scale, poses[h], value)
    return shifted


cdef Py_ssize_t flag_facing(PointViews views, const double[:, ::1] poses, const double[::1] angles, double least,
                            unsigned char[::1] faces) except -1 nogil:
    """Flag points whose normal has a component above `least` along the angle of any candidate; return their number."""
    cdef Py_ssize_t h, k, count = 0
    cdef double c, s
    for h in range(poses.shape[0]):
        c, s = cos(poses[h, 2] - angles[h]), sin(poses[h, 2] - angles[h])
        for k in range(views.size):
            if not faces[k] and fabs(c * views.normals[k].real - s * views.normals[k].imag) > least:
                faces[k] = True
                count += 1
    return count


cdef int shift_along(Comparison comparison, PointViews views, const unsigned char[::1] faces, double angle,
                     double step, double scale, double[::1] candidate, double[::1] value) except -1 nogil:
    """Shift a candidate ``(x, y, theta)`` along an `angle` [rad] by the multiple of `step` [m] with the largest value.

    The `value` of each multiple is the sum over the points of their kernel of `scale` [m] (Eq. 18) times the squared
    component of the normal, minus the penalty for points in free space. The shortest come first, and of equal values
    that of the shortest shift is chosen.
    """
    cdef double factor = -0.5 / (scale * scale), c = cos(angle), s = sin(angle), shift
    cdef double e, weight, component, lost
    cdef Py_ssize_t n, k
    cdef Match found
    cdef Pose pose
    pose.c, pose.s = cos(candidate[2]), sin(candidate[2])
    for n in range(value.shape[0]):
        shift = shift_of(n, step)
        pose.x, pose.y, value[n] = candidate[0] + shift * c, candidate[1] + shift * s, 0.0
        for k in range(views.size):
            if not faces[k]:
                continue
            match_point(views, comparison.field, k, &pose, comparison.min_cosine, &found)
            e = found.error * views.inverse_noise[k]
            weight = exp(factor * e * e) if found.alike else 0.0
            component = (found.nx * c - found.ny * s) * views.inverse_noise[k]
            lost = violation(comparison.near, found.x + pose.x, found.y + pose.y,
                             comparison.tolerance / views.inverse_noise[k])
            value[n] += weight * component * component - comparison.against * lost * (1.0 - weight)
        value[n] -= TINY * fabs(shift)
    shift = shift_of(first_largest(value), step)
    candidate[0], candidate[1] = candidate[0] + shift * c, candidate[1] + shift * s
    return 0


cdef inline double shift_of(Py_ssize_t n, double step) noexcept nogil:
    """Return the n-th of the multiples of a step, the shortest first: 0, -1, 1, -2, 2 and so on."""
    return <double> ((n + 1) // 2) * (step if n % 2 == 0 else -step)
