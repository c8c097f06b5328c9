# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Scores of hypotheses, and which of them differ (section 2.3)."""
import numpy as np

from ..features.oriented_points import sample
from ..geometry import tolerance

from libc.math cimport cos, fabs, sin

from ..features.oriented_points cimport OrientedPoints
from ..geometry.exponential cimport decaying_exp
from ..geometry.ordering cimport first_largest, sort_up_to_rounding
from ..geometry.plane cimport bin_of, length_of
from .point_to_line cimport Hypotheses, Hypothesis, Match, Pose, match_point, pose_at
from .views cimport lines_of

cdef double TINY = tolerance.TINY


def find_rivals(candidates, direction, parameters):
    """Return which hypotheses ``(H, 3)`` differ from the first by `decision.rival_distance` or `decision.rival_angle`.

    The result is ``(H,)`` bool. Differences along a degenerate `direction` [rad] or None do not count.
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
        flag[h] = not are_near(poses[h, 0] - x, poses[h, 1] - y, poses[h, 2] - theta, apart, angle)
    return flags


cdef class Comparison:
    """What hypotheses are compared by: both scans, and parameters as numbers."""

    def __cinit__(self, problem):
        p, current = problem.parameters, problem.current
        self.problem, self.field = problem, lines_of(problem.reference.likelihood_field)
        self.own, self.share = current.sampled_points, current.leverage
        self.near = problem.reference.free_space.near
        self.min_cosine, self.damping = p.density.min_normal_cosine, p.refinement.damping
        self.score_scale, self.tolerance = p.refinement.score_scale, p.density.violation_tolerance
        self.against = p.density.violation_weight


def scores(problem, candidates):
    """Return score, overlap and conflict ``(H,)`` of hypotheses ``(H, 3)`` [m, m, rad], as `write_scores` has them."""
    cdef Hypotheses found = Hypotheses(candidates)
    cdef Py_ssize_t h
    write_scores(Comparison(problem), found)
    table = np.empty((3, found.size))
    cdef double[:, ::1] values = table
    for h in range(found.size):
        values[0, h], values[1, h] = found.rows[h].score, found.rows[h].overlap
        values[2, h] = found.rows[h].conflict
    return tuple(table)


def reverse_conflicts(problem, candidates):
    """Return the fraction ``(H,)`` of `write_reverse_conflicts`, 0..1, of the hypotheses ``(H, 3)`` [m, m, rad]."""
    fraction = np.empty(len(candidates))
    write_reverse_conflicts(Comparison(problem), Hypotheses(candidates), fraction)
    return fraction


cdef int write_scores(Comparison comparison, Hypotheses found) except -1 nogil:
    """Write score, overlap and conflict of each hypothesis by the current scan's points.

    The score is the weighted fraction of the points on the reference's surfaces, less `violation_weight` times the
    weighted fraction in its free space; the overlap is the unweighted fraction on the surfaces, and the conflict the
    weighted fraction in free space.
    """
    cdef double factor = -0.5 / (comparison.score_scale * comparison.score_scale), weight, lost, e
    cdef double value, overlap, conflict
    cdef Py_ssize_t h, k
    cdef Match match
    cdef Pose pose
    for h in range(found.size):
        pose = pose_at(found.rows[h].x, found.rows[h].y, found.rows[h].theta)
        value = overlap = conflict = 0.0
        for k in range(comparison.own.size):
            match_point(comparison.own, comparison.field, k, &pose, comparison.min_cosine, &match)
            # Gaussian kernel (Eq. 18), 0 where the normals disagree.
            e = match.error * comparison.own.inverse_noise_view[k]
            weight = decaying_exp(factor * e * e) if match.alike else 0.0
            lost = violation(comparison.near, match.x + pose.x, match.y + pose.y,
                             comparison.tolerance / comparison.own.inverse_noise_view[k])
            value += (weight - comparison.against * lost * (1.0 - weight)) * comparison.share[k]
            overlap += weight
            conflict += lost * comparison.share[k]
        found.rows[h].score, found.rows[h].conflict = value, conflict
        found.rows[h].overlap = overlap / <double> max(comparison.own.size, 1)
    return 0


cdef int write_reverse_conflicts(Comparison comparison, Hypotheses found, double[::1] fraction) except -1:
    """Write the weighted fraction of the reference's points in free space of the current scan, of each hypothesis."""
    reference = comparison.problem.reference
    cdef OrientedPoints points = reference.sampled_points
    cdef const double[::1] near = comparison.problem.current.free_space.near, share = reference.leverage
    cdef Py_ssize_t h, k
    cdef double x, y
    cdef Pose pose
    with nogil:
        for h in range(found.size):
            pose, fraction[h] = pose_at(found.rows[h].x, found.rows[h].y, found.rows[h].theta), 0.0  # inverse of Eq. 8
            for k in range(points.size):
                x, y = points.points_view[k].real - pose.x, points.points_view[k].imag - pose.y
                fraction[h] += share[k] * violation(near, pose.c * x + pose.s * y, pose.c * y - pose.s * x,
                                                    comparison.tolerance / points.inverse_noise_view[k])
    return 0


def preselect(candidates, points, profile, parameters, density):
    """Return the candidates ``(S, 3)`` that align a scan best with the reference's outline, S up to `preselected`.

    Only the free-space profile of the reference is looked up, not its likelihood field.

    Parameters
    ----------
    candidates : (C, 3) array [m, m, rad]
    points : OrientedPoints
        Points of the current scan.
    profile : FreeSpaceProfile
        Free-space profile of the reference.
    parameters : SelectionParameters
    density : DensityParameters
    """
    cdef Py_ssize_t most = parameters.preselected, size = len(candidates), h, k, at
    if size <= most:
        return candidates
    cdef OrientedPoints some = sample(points, parameters.preselection_points)
    cdef const double[:, :] motion = candidates
    cdef const double[::1] near = profile.near, far = profile.far
    cdef double tolerance = parameters.preselection_tolerance, against = density.violation_weight, x, y, radius
    # Negative: the best come first.
    cdef double[::1] support = np.zeros(size)
    cdef Py_ssize_t[:, ::1] work = np.empty((2, size), np.intp)
    cdef Pose pose
    with nogil:
        for h in range(size):
            pose = pose_at(motion[h, 0], motion[h, 1], motion[h, 2])  # Eq. 8
            for k in range(some.size):
                x = pose.c * some.points_view[k].real - pose.s * some.points_view[k].imag + pose.x
                y = pose.s * some.points_view[k].real + pose.c * some.points_view[k].imag + pose.y
                at, radius = bin_of(x, y, near.shape[0]), length_of(x, y)
                if near[at] > 0.0:
                    support[h] -= min(max(1.0 - max(near[at] - radius, radius - far[at]) / tolerance, 0.0), 1.0)
                support[h] += against * violation(near, x, y, tolerance)
        sort_up_to_rounding(support, work[0], work[1])
    return candidates[np.asarray(work[0, :most])]


def within_gate(candidates, prior, parameters):
    """Return ``(H,)`` bool: which hypotheses ``(H, 3)`` [m, m, rad] lie within `prior.gate` sigmas of a `Prior`."""
    distance, angle = parameters.gate * prior.translation_sigma, parameters.gate * prior.rotation_sigma
    return same(candidates, prior.transform.as_array(), distance, angle)


def distinct(candidates, Py_ssize_t count, double distance, double angle):
    """Return indices (list) of the first `count` of ``(H, 3)`` motions [m, m, rad] that differ from all chosen before.

    Two hypotheses differ if they are more than `distance` [m] or more than `angle` [rad] apart.
    """
    cdef Hypotheses found = Hypotheses(candidates)
    count = choose_distinct(found, count, distance, angle, found.index[0], found.index[1])
    return np.asarray(found.index[1, :count]).tolist()


cdef Py_ssize_t choose_distinct(Hypotheses found, Py_ssize_t most, double most_apart, double angle,
                                Py_ssize_t[::1] flag, Py_ssize_t[::1] chosen) except -1:
    """Flag the first hypotheses that differ from all chosen before, by a distance or an angle; count them."""
    cdef Py_ssize_t k, i, count = 0
    cdef bint differs
    cdef Hypothesis *one
    cdef Hypothesis *other
    for k in range(found.size):
        if count == most:
            break
        differs, one = True, &found.rows[k]
        for i in range(count):
            other = &found.rows[chosen[i]]
            if are_near(one.x - other.x, one.y - other.y, one.theta - other.theta, most_apart, angle):
                differs = False
                break
        if differs:
            chosen[count], flag[k] = k, True
            count += 1
    return count


def same(const double[:, :] candidates, const double[:] one, double distance, double angle):
    """Return ``(H,)`` bool: which of ``(H, 3)`` [m, m, rad] lie within `distance` [m] and `angle` [rad] of `one`."""
    flags = np.empty(candidates.shape[0], dtype=bool)
    cdef unsigned char[::1] near = flags
    cdef Py_ssize_t h
    for h in range(near.shape[0]):
        near[h] = are_near(candidates[h, 0] - one[0], candidates[h, 1] - one[1], candidates[h, 2] - one[2], distance,
                           angle)
    return flags


def search_degenerate_direction(candidates, angles, problem):
    """Shift each candidate along its degenerate direction to where the points with normals in this direction fit best.

    Parameters
    ----------
    candidates : (H, 3) array [m, m, rad]
    angles : (H,) array [rad]
        Degenerate direction of each candidate in the reference's frame.
    problem : Problem

    Returns
    -------
    (H, 3) array [m, m, rad]
    """
    return search_along(Comparison(problem), candidates, angles)


cdef search_along(Comparison comparison, candidates, const double[::1] angles):
    """Shift each candidate ``(H, 3)`` along its angle [rad] to the best fit, first coarsely, then finely."""
    p, last = comparison.problem.parameters, comparison.score_scale
    cdef OrientedPoints points = comparison.own
    cdef double least = p.translation.min_crossing_sine, reach, step, scale
    cdef Py_ssize_t h, facing
    shifted = np.array(candidates)
    cdef double[:, ::1] poses = shifted
    cdef unsigned char[::1] faces = np.zeros(points.size, np.uint8)
    cdef double[::1] value
    with nogil:
        facing = flag_facing(points, poses, angles, least, faces)
    if facing < p.degeneracy.min_points:
        return shifted
    for reach, step, scale in (
            (p.degeneracy.search_distance, 2.0 * last, 3.0 * last), (2.5 * last, 0.4 * last, last)):
        value = np.empty(2 * <Py_ssize_t> (reach / step) + 1)
        for h in range(poses.shape[0]):
            with nogil:
                shift_along(comparison, points, faces, angles[h], step, scale, poses[h], value)
    return shifted


cdef Py_ssize_t flag_facing(OrientedPoints points, const double[:, ::1] poses, const double[::1] angles, double least,
                            unsigned char[::1] faces) except -1 nogil:
    """Flag points whose normal has a component above `least` along the angle of any candidate; return their number."""
    cdef Py_ssize_t h, k, count = 0
    cdef double c, s
    for h in range(poses.shape[0]):
        c, s = cos(poses[h, 2] - angles[h]), sin(poses[h, 2] - angles[h])
        for k in range(points.size):
            if not faces[k] and fabs(c * points.normals_view[k].real - s * points.normals_view[k].imag) > least:
                faces[k] = True
                count += 1
    return count


cdef int shift_along(Comparison comparison, OrientedPoints points, const unsigned char[::1] faces, double angle,
                     double step, double scale, double[::1] candidate, double[::1] value) except -1 nogil:
    """Shift a candidate ``(x, y, theta)`` along an `angle` [rad] by the multiple of `step` [m] with the largest value.

    The `value` of each multiple is the sum over the points of their kernel of `scale` [m] (Eq. 18) times the squared
    component of the normal, minus the penalty for points in free space. The shortest come first, and of equal values
    that of the shortest shift is chosen.
    """
    cdef double factor = -0.5 / (scale * scale), c = cos(angle), s = sin(angle), shift, e, weight, component, lost
    cdef Py_ssize_t n, k
    cdef Match found
    cdef Pose pose
    pose.c, pose.s = cos(candidate[2]), sin(candidate[2])
    for n in range(value.shape[0]):
        shift = shift_of(n, step)
        pose.x, pose.y, value[n] = candidate[0] + shift * c, candidate[1] + shift * s, 0.0
        for k in range(points.size):
            if not faces[k]:
                continue
            match_point(points, comparison.field, k, &pose, comparison.min_cosine, &found)
            e = found.error * points.inverse_noise_view[k]
            weight = decaying_exp(factor * e * e) if found.alike else 0.0
            component = (found.nx * c - found.ny * s) * points.inverse_noise_view[k]
            lost = violation(comparison.near, found.x + pose.x, found.y + pose.y,
                             comparison.tolerance / points.inverse_noise_view[k])
            value[n] += weight * component * component - comparison.against * lost * (1.0 - weight)
        value[n] -= TINY * fabs(shift)
    shift = shift_of(first_largest(value), step)
    candidate[0], candidate[1] = candidate[0] + shift * c, candidate[1] + shift * s
    return 0


cdef inline double shift_of(Py_ssize_t n, double step) noexcept nogil:
    """Return the n-th of the multiples of a step, the shortest first: 0, -1, 1, -2, 2 and so on."""
    return <double> ((n + 1) // 2) * (step if n % 2 == 0 else -step)
