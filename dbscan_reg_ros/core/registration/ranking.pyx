# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Refinement and ranking of hypotheses by the density of the reference (section 2.3)."""
import numpy as np

from ..features.oriented_points import sample
from ..geometry import tolerance
from ..parameters import registration as scales
from .scoring import preselect

from libc.math cimport cos, sin, sqrt
from libc.string cimport memcpy

from ..features.oriented_points cimport BLOCK, OrientedPoints
from ..geometry.ordering cimport sort_up_to_rounding
from ..geometry.plane cimport length_of, wrap
from ..geometry.symmetric cimport Weakest, squared_distance, weakest_direction
from .point_to_line cimport Equations, Hypotheses, Hypothesis, Matches, Pose, add_points, match_points, pose_at
from .point_to_line cimport refine_hypotheses, solve_step, weigh
from .scoring cimport PRESELECTION_POINTS, RIVAL_ANGLE, RIVAL_DISTANCE, Comparison, choose_distinct, search_along
from .scoring cimport write_reverse_conflicts, write_scores

cdef double TINY = tolerance.TINY
cdef const double[::1] COARSE_SCALES = scales.COARSE_SCALES, FINE_SCALES = scales.FINE_SCALES
cdef double COARSE_SCALE = scales.COARSE_SCALE, FINE_SCALE = scales.FINE_SCALE, FINAL_SCALE = scales.FINAL_SCALE

cdef enum:
    # The best hypothesis is compared with at most this many rivals (hypotheses with different motions).
    RIVALS = 7

# Hypotheses that differ by less than this [m, rad] are the same motion: they converge to one pose.
cdef double SAME_DISTANCE = 0.05, SAME_ANGLE = 0.02


def rank_by_density(problem, candidates, double min_score):
    """Refine the hypotheses and rank them by their scores: coarsely, and finely.

    Parameters
    ----------
    problem : Problem
    candidates : Candidates
        At least one.
    min_score : float
        Refinement ends as soon as the best score is known to be at most this.

    Returns
    -------
    Hypotheses
        Best first.
    """
    cdef Search search = Search(problem)
    cdef Hypotheses found = rank_coarsely(search, candidates)
    if found.rows[0].score > min_score:
        rank_finely(search, found)
    return found


cdef class Search(Comparison):
    """A comparison of hypotheses with each other, and with a prior if there is one."""

    # Of the prior: motion [m, m, rad], covariance in its frame, least distance that counts, and its weight in scores.
    cdef double x, y, theta, gate, prior_weight
    cdef const double[:, ::1] covariance
    cdef bint has_prior

    def __cinit__(self, problem):
        p, prior = problem.parameters, problem.prior
        self.has_prior = prior is not None
        if self.has_prior:
            expected = prior.transform
            self.x, self.y, self.theta = expected.x, expected.y, expected.theta
            self.covariance = np.ascontiguousarray(prior.covariance, dtype=float)
            self.gate, self.prior_weight = p.prior.gate, p.prior.weight


cdef Hypotheses rank_coarsely(Search search, candidates):
    """Refine hypotheses with a kernel that narrows from `COARSE_SCALE`; return them best first."""
    problem = search.problem
    p, points = problem.parameters, problem.current.sampled_points
    cdef Hypotheses found, again
    cdef double[3] step
    cdef Equations sums
    cdef Pose pose
    exempt, others = candidates
    if search.has_prior:
        found = Hypotheses(exempt, preselect(others, points, problem.reference.free_space, p.selection, p.density))
        improve(search, found, search.points, COARSE_SCALES, False)
        return found
    cdef OrientedPoints some = sample(points, PRESELECTION_POINTS)
    found = Hypotheses(exempt, others)
    keep_supported(search, found, some, COARSE_SCALE, p.selection.min_support_ratio)
    improve(search, found, some, COARSE_SCALES, False)
    # One more step by all points: where the best has not converged, all are refined once more.
    pose = pose_at(found.rows[0].x, found.rows[0].y, found.rows[0].theta)
    add_points(search.points, search.field, &pose, FINE_SCALE, &sums)
    solve_step(&sums, search.damping, step)
    if length_of(step[0], step[1]) < FINAL_SCALE:
        return found
    again = Hypotheses(found.motions())
    improve(search, again, search.points, COARSE_SCALES, False)
    found.reserve(found.size + again.size)
    memcpy(&found.rows[found.size], again.rows, again.size * sizeof(Hypothesis))
    found.size += again.size
    sort_by_score(search, found)
    return found


cdef int keep_supported(Search search, Hypotheses found, OrientedPoints points, double scale,
                        double min_ratio) except -1 nogil:
    """Keep the hypotheses with at least `min_ratio` of the best one's support by a kernel of `scale` [m] (Eq. 18)."""
    cdef double[::1] support = found.number[0]
    cdef double most = 0.0
    cdef Py_ssize_t h, first, k, count = 0
    cdef Matches match
    cdef Pose pose
    for h in range(found.size):
        pose, support[h] = pose_at(found.rows[h].x, found.rows[h].y, found.rows[h].theta), 0.0
        first = 0
        while first < points.size:
            match_points(points, search.field, first, &pose, &match)
            weigh(&match, scale)
            for k in range(match.size):
                support[h] += match.weight[k]
            first += BLOCK
        most = max(most, support[h])
    for h in range(found.size):
        if support[h] >= min_ratio * most:
            found.index[0, count] = h
            count += 1
    return found.select(found.index[0], count)


cdef int improve(Search search, Hypotheses found, OrientedPoints points, const double[::1] scales,
                 bint both_ways) except -1:
    """Refine all hypotheses by some points of the current scan, and sort them by their scores by all sampled points."""
    cdef Py_ssize_t h
    with nogil:
        refine_hypotheses(points, search.field, search.damping, scales, found)
        write_scores(search, found)
    if both_ways:
        write_reverse_conflicts(search, found, found.number[0])
        for h in range(found.size):
            found.rows[h].score -= search.violation_weight * found.number[0, h]
    if search.has_prior:
        subtract_prior(search, found)
    return sort_by_score(search, found)


cdef int subtract_prior(Search search, Hypotheses found) except -1 nogil:
    """Subtract the squared Mahalanobis distance from the prior over that of the gate, at most 1, times `prior.weight`.

    The nearest to the prior become the first, so that they are the first of equal scores.
    """
    cdef double c = cos(search.theta), s = sin(search.theta), x, y
    cdef double[::1] distance = found.number[0, :found.size]
    cdef double[3] error
    cdef Py_ssize_t h
    for h in range(found.size):
        x, y = found.rows[h].x - search.x, found.rows[h].y - search.y
        error[0], error[1], error[2] = c * x + s * y, c * y - s * x, wrap(found.rows[h].theta - search.theta)
        distance[h] = squared_distance(search.covariance, error) / (search.gate * search.gate)
        found.rows[h].score -= search.prior_weight * min(distance[h], 1.0)
    sort_up_to_rounding(distance, found.index[0], found.index[1])
    return found.select(found.index[0], found.size)


cdef int sort_by_score(Search search, Hypotheses found) except -1 nogil:
    """Sort hypotheses, the largest score first."""
    cdef double[::1] keys = found.number[0, :found.size]
    cdef Py_ssize_t h
    for h in range(found.size):
        keys[h] = -found.rows[h].score
    sort_up_to_rounding(keys, found.index[0], found.index[1])
    return found.select(found.index[0], found.size)


cdef int rank_finely(Search search, Hypotheses found) except -1:
    """Refine the top candidates with a kernel that narrows to `FINAL_SCALE`, and compare them both ways."""
    cdef Hypothesis best
    keep_top_candidates(search, found)
    best = found.rows[0]
    add_shifted(search, found)
    if found.size > 1:
        return improve(search, found, search.points, FINE_SCALES, True)
    if not search.problem.parameters.refinement.polish_iterations:
        # Only the pose is replaced.
        refine_hypotheses(search.points, search.field, search.damping, FINE_SCALES, found)
        best.x, best.y, best.theta = found.rows[0].x, found.rows[0].y, found.rows[0].theta
        found.rows[0] = best
    return 0


cdef int keep_top_candidates(Search search, Hypotheses found) except -1:
    """Keep the hypotheses that are compared finely, most plausible first: the best, and rivals of it."""
    p = search.problem.parameters
    s = p.selection
    cdef Py_ssize_t[::1] index = found.index[0], flag = found.index[2]
    cdef double[::1] value = found.number[0], least = found.number[1, :found.size]
    cdef Py_ssize_t h, count
    cdef double gap = s.max_score_gap
    if choose_distinct(found, 2, SAME_DISTANCE, SAME_ANGLE, flag, index) == 1:
        index[0] = 0
        return found.select(index, 1)
    write_reverse_conflicts(search, found, value)
    for h in range(found.size):
        # Negative: the most plausible come first.
        least[h] = -(found.rows[h].score - sqrt(found.rows[h].conflict) - sqrt(value[h]))
    sort_up_to_rounding(least, index, found.index[1])
    count = 0
    while count < found.size and least[index[count]] <= least[index[0]] + gap:
        count += 1
    found.select(index, count)
    flag[:] = False
    choose_distinct(found, s.top_candidates, SAME_DISTANCE, SAME_ANGLE, flag, index)
    choose_distinct(found, 1 + RIVALS, RIVAL_DISTANCE, RIVAL_ANGLE, flag, index)
    count = 0
    for h in range(found.size):
        if flag[h]:
            index[count] = h
            count += 1
    return found.select(index, count)


cdef int add_shifted(Search search, Hypotheses found) except -1:
    """Append to the hypotheses, for each with a degenerate direction, a better one along it, where there is one."""
    cdef double ratio = search.problem.parameters.degeneracy.information_ratio
    cdef Weakest weakest
    cdef Equations *e
    cdef Py_ssize_t h
    cdef list degenerate = [], angles = []
    for h in range(found.size):
        e = &found.rows[h].equations
        weakest = weakest_direction(e.xx, e.xy, e.xt, e.yy, e.yt, e.tt)
        if weakest.weak < ratio * weakest.strong:
            degenerate.append(h)
            angles.append(weakest.angle)
    if not degenerate:
        return 0
    candidates = found.motions()[degenerate]
    shifted = search_along(search, candidates, np.array(angles))
    return found.add(shifted[(np.abs(shifted - candidates) > TINY).any(axis=1)])
