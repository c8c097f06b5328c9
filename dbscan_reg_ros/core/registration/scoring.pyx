# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Scores of hypotheses, and which of them differ (section 2.3)."""
import numpy as np

from ..features.oriented_points import sample
from ..geometry import tolerance
from ..parameters import registration as scales

from libc.math cimport cos, fabs, sin

from ..features.free_space cimport PlacedPoints, in_front, write_bins, write_violations
from ..features.oriented_points cimport BLOCK, OrientedPoints
from ..geometry.ordering cimport first_largest, sort_up_to_rounding
from ..geometry.plane cimport length_of
from .point_to_line cimport Hypotheses, Hypothesis, Matches, Pose, match_points, pose_at, weigh
from .views cimport lines_of

cdef double TINY = tolerance.TINY

RIVAL_DISTANCE, RIVAL_ANGLE = 0.2, 0.09
VIOLATION_TOLERANCE = 0.15
PRESELECTION_POINTS = 60
# Least number of points that face a degenerate direction: one fits everywhere along it.
cdef Py_ssize_t MIN_FACING = 2


def find_rivals(candidates, direction):
    """Return which hypotheses ``(H, 3)`` differ from the first by `RIVAL_DISTANCE` or `RIVAL_ANGLE`.

    The result is ``(H,)`` bool. Differences along a degenerate `direction` [rad] or None do not count.
    """
    cdef double[:, ::1] poses = np.array(candidates)
    cdef Py_ssize_t h
    cdef double x = poses[0, 0], y = poses[0, 1], theta = poses[0, 2], c, s, off
    flags = np.zeros(poses.shape[0], dtype=bool)
    cdef unsigned char[::1] flag = flags
    if direction is not None:
        c, s = cos(direction), sin(direction)
        for h in range(poses.shape[0]):
            off = (poses[h, 0] - x) * c + (poses[h, 1] - y) * s
            poses[h, 0], poses[h, 1] = poses[h, 0] - off * c, poses[h, 1] - off * s
    for h in range(poses.shape[0]):
        flag[h] = not are_near(poses[h, 0] - x, poses[h, 1] - y, poses[h, 2] - theta, RIVAL_DISTANCE,
                               RIVAL_ANGLE)
    return flags


cdef class Comparison:
    """What hypotheses are compared by: both scans, and parameters as numbers."""

    def __cinit__(self, problem):
        p, current = problem.parameters, problem.current
        self.problem, self.field = problem, lines_of(problem.reference.likelihood_field)
        self.points, self.leverage = current.sampled_points, current.leverage
        self.free_space = problem.reference.free_space.near
        self.damping, self.violation_weight = p.refinement.damping, p.density.violation_weight
        self.score_scale, self.tolerance = scales.SCORE_SCALE, VIOLATION_TOLERANCE
        if self.leverage.shape[0] != self.points.size:
            raise IndexError('arrays of different lengths')


def scores(problem, candidates):
    """Return score, overlap, conflict and reverse conflict ``(H,)`` of hypotheses ``(H, 3)`` [m, m, rad].

    They are those of `write_scores` and `write_reverse_conflicts`.
    """
    cdef Comparison comparison = Comparison(problem)
    cdef Hypotheses found = Hypotheses(candidates)
    cdef Py_ssize_t h
    table = np.empty((4, found.size))
    cdef double[:, ::1] values = table
    write_scores(comparison, found)
    write_reverse_conflicts(comparison, found, values[3])
    for h in range(found.size):
        values[0, h], values[1, h] = found.rows[h].score, found.rows[h].overlap
        values[2, h] = found.rows[h].conflict
    return tuple(table)


cdef int write_scores(Comparison comparison, Hypotheses found) except -1 nogil:
    """Write score, overlap and conflict of each hypothesis by the current scan's points.

    The score is the weighted fraction of the points on the reference's surfaces, less `violation_weight` times the
    weighted fraction in its free space; the overlap is the unweighted fraction on the surfaces, and the conflict the
    weighted fraction in free space.
    """
    cdef double value, overlap, conflict
    cdef const double *leverage
    cdef Py_ssize_t h, first, k
    cdef Matches match
    cdef PlacedPoints seen
    cdef Pose pose
    for h in range(found.size):
        pose = pose_at(found.rows[h].x, found.rows[h].y, found.rows[h].theta)
        value = overlap = conflict = 0.0
        first = 0
        while first < comparison.points.size:
            match_points(comparison.points, comparison.field, first, &pose, &match)
            weigh(&match, comparison.score_scale)
            place(comparison.points, first, &pose, &seen)
            write_violations(&seen, comparison.free_space, comparison.tolerance,
                             &comparison.points.inverse_noise_view[first])
            leverage = &comparison.leverage[first]
            for k in range(match.size):
                value += (match.weight[k] - comparison.violation_weight * seen.violation[k]
                          * (1.0 - match.weight[k])) * leverage[k]
                overlap += match.weight[k]
                conflict += seen.violation[k] * leverage[k]
            first += BLOCK
        found.rows[h].score, found.rows[h].conflict = value, conflict
        found.rows[h].overlap = overlap / <double> max(comparison.points.size, 1)
    return 0


cdef int write_reverse_conflicts(Comparison comparison, Hypotheses found, double[::1] fraction) except -1:
    """Write the weighted fraction of the reference's points in free space of the current scan, of each hypothesis."""
    reference = comparison.problem.reference
    cdef OrientedPoints points = reference.sampled_points
    cdef const double[::1] near = comparison.problem.current.free_space.near, leverage = reference.leverage
    cdef Py_ssize_t h, first, k
    cdef double sum
    cdef PlacedPoints seen
    cdef Pose pose
    with nogil:
        for h in range(found.size):
            pose, sum = pose_at(found.rows[h].x, found.rows[h].y, found.rows[h].theta), 0.0
            first = 0
            while first < points.size:
                place_back(points, first, &pose, &seen)
                write_violations(&seen, near, comparison.tolerance, &points.inverse_noise_view[first])
                for k in range(seen.size):
                    sum += leverage[first + k] * seen.violation[k]
                first += BLOCK
            fraction[h] = sum
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
    cdef Py_ssize_t most = parameters.preselected, size = len(candidates), h, first, k, at
    if size <= most:
        return candidates
    cdef OrientedPoints some = sample(points, PRESELECTION_POINTS)
    cdef const double[:, :] motion = candidates
    cdef const double[::1] near = profile.near, far = profile.far
    cdef double tolerance = parameters.preselection_tolerance, weight = density.violation_weight, radius
    # Negative: the best come first.
    cdef double[::1] support = np.zeros(size)
    cdef Py_ssize_t[:, ::1] work = np.empty((2, size), np.intp)
    cdef PlacedPoints seen
    cdef Pose pose
    with nogil:
        for h in range(size):
            pose = pose_at(motion[h, 0], motion[h, 1], motion[h, 2])
            first = 0
            while first < some.size:
                place(some, first, &pose, &seen)
                write_bins(&seen, near.shape[0])
                for k in range(seen.size):
                    at, radius = seen.bin[k], length_of(seen.x[k], seen.y[k])
                    if near[at] > 0.0:
                        support[h] -= min(max(1.0 - max(near[at] - radius, radius - far[at]) / tolerance, 0.0), 1.0)
                    support[h] += weight * in_front(near[at], seen.x[k], seen.y[k], tolerance)
                first += BLOCK
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
    """Choose the first hypotheses that differ from all chosen before, by a distance or an angle; return their number.

    Their indices are written, and their flags set; other flags stay as they are.
    """
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
    """Shift candidates ``(H, 3)`` [m, m, rad] by `search_along` in their degenerate directions ``(H,)`` [rad]."""
    return search_along(Comparison(problem), candidates, angles)


cdef search_along(Comparison comparison, candidates, const double[::1] angles):
    """Shift each candidate ``(H, 3)`` along its angle [rad] to where the points that face it fit best."""
    cdef double last = comparison.score_scale
    cdef OrientedPoints points = comparison.points
    cdef double least = scales.MIN_CROSSING_SINE, reach, step, scale
    cdef Py_ssize_t h
    shifted = np.array(candidates)
    cdef double[:, ::1] poses = shifted
    cdef double[::1] value
    points = points.select(facing(points, poses, angles, least))
    if points.size < MIN_FACING:
        return shifted
    for reach, step, scale in ((scales.SEARCH_DISTANCE, 2.0 * last, 3.0 * last), (2.5 * last, 0.4 * last, last)):
        value = np.empty(2 * <Py_ssize_t> (reach / step) + 1)
        for h in range(poses.shape[0]):
            with nogil:
                shift_along(comparison, points, angles[h], step, scale, poses[h], value)
    return shifted


cdef facing(OrientedPoints points, const double[:, ::1] poses, const double[::1] angles, double least):
    """Return ``(P,)`` bool: which points have a normal with a component above `least` along the angle of any pose."""
    faces = np.zeros(points.size, bool)
    cdef unsigned char[::1] flag = faces
    cdef Py_ssize_t h, k
    cdef double c, s
    for h in range(poses.shape[0]):
        c, s = cos(poses[h, 2] - angles[h]), sin(poses[h, 2] - angles[h])
        for k in range(points.size):
            flag[k] |= fabs(c * points.normals_view[k].real - s * points.normals_view[k].imag) > least
    return faces


cdef int shift_along(Comparison comparison, OrientedPoints points, double angle, double step,
                     double scale, double[::1] candidate, double[::1] value) except -1 nogil:
    """Shift a candidate ``(x, y, theta)`` along an `angle` [rad] by the multiple of `step` [m] with the largest value.

    The `value` of each multiple is the sum over the points of their kernel of `scale` [m] (Eq. 18) times the squared
    component of the normal, minus the penalty for points in free space. The shortest come first, and of equal values
    that of the shortest shift is chosen.
    """
    cdef double c = cos(angle), s = sin(angle), shift, component
    cdef Py_ssize_t n, first, k
    cdef Matches match
    cdef PlacedPoints seen
    cdef Pose pose
    pose.c, pose.s = cos(candidate[2]), sin(candidate[2])
    for n in range(value.shape[0]):
        shift = shift_of(n, step)
        pose.x, pose.y, value[n] = candidate[0] + shift * c, candidate[1] + shift * s, 0.0
        first = 0
        while first < points.size:
            match_points(points, comparison.field, first, &pose, &match)
            weigh(&match, scale)
            place(points, first, &pose, &seen)
            write_violations(&seen, comparison.free_space, comparison.tolerance, &points.inverse_noise_view[first])
            for k in range(match.size):
                component = match.nx[k] * c - match.ny[k] * s
                value[n] += (match.weight[k] * component * component
                             - comparison.violation_weight * seen.violation[k] * (1.0 - match.weight[k]))
            first += BLOCK
        value[n] -= TINY * fabs(shift)
    shift = shift_of(first_largest(value), step)
    candidate[0], candidate[1] = candidate[0] + shift * c, candidate[1] + shift * s
    return 0


cdef inline double shift_of(Py_ssize_t n, double step) noexcept nogil:
    """Return the n-th of the multiples of a step, the shortest first: 0, -1, 1, -2, 2 and so on."""
    return <double> ((n + 1) // 2) * (step if n % 2 == 0 else -step)
