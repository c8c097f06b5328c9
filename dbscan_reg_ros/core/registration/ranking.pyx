# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Refinement and ranking of hypotheses by the density of the reference (section 2.3)."""
import numpy as np

from ..features.free_space import in_front
from ..features.oriented_points import sample
from ..geometry import tolerance
from ..geometry.ties import order_up_to_rounding
from .hypotheses import Ranking
from .point_to_line import fit
from .residuals import transform_points

from libc.math cimport cos, exp, fabs, sin, sqrt

from ..geometry.ordering cimport sort_up_to_rounding
from ..geometry.plane cimport length_of, wrap
from ..geometry.symmetric cimport Weakest, squared_distance, weakest_direction
from .point_to_line cimport COLUMNS, CONFLICT, EQUATIONS, SCORE, Equations, Match, Pose, add_points, match_point
from .point_to_line cimport read_pose, refine_poses, solve_step, table_of
from .scoring cimport Comparison, add_reverse_conflicts, search_along, write_scores
from .views cimport PointViews, views_of

cdef double TINY = tolerance.TINY


cdef enum:
    # The best hypothesis is compared with at most this many rivals (hypotheses with different motions).
    RIVALS = 7


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
    Ranking
    """
    cdef Comparison comparison = Comparison(problem)
    points = problem.current.sampled_points
    cdef double[:, ::1] ranked = rank_coarsely(comparison, candidates, points)
    if ranked[0, SCORE] > min_score:
        ranked = rank_finely(comparison, ranked)
    table, count = np.asarray(ranked), ranked.shape[0]
    poses = np.ascontiguousarray(table[:, :SCORE])
    return Ranking(poses, *table.T[SCORE:EQUATIONS].copy(), table[:, EQUATIONS:].reshape(count, 4, 4), np.zeros(count),
                   fit(poses[:1], points, problem.reference.likelihood_field, comparison.min_cosine))


cdef double[:, ::1] chosen_rows(const double[:, ::1] rows, const Py_ssize_t[::1] index, Py_ssize_t count):
    """Return the first `count` rows whose `index` is given."""
    cdef double[:, ::1] chosen = np.empty((count, COLUMNS))
    cdef Py_ssize_t h, k
    for h in range(count):
        for k in range(COLUMNS):
            chosen[h, k] = rows[index[h], k]
    return chosen


cdef double[:, ::1] best_first(const double[:, ::1] rows):
    """Return the rows of a table of hypotheses, the largest score first."""
    cdef Py_ssize_t size = rows.shape[0], h
    cdef Py_ssize_t[:, ::1] work = np.empty((2, size), np.intp)
    cdef double[::1] keys = np.empty(size)
    for h in range(size):
        keys[h] = -rows[h, SCORE]
    sort_up_to_rounding(keys, work[0], work[1])
    return chosen_rows(rows, work[0], size)


cdef double[:, ::1] rank_coarsely(Comparison comparison, candidates, points):
    """Refine hypotheses with a kernel that narrows from `refinement.coarse_scale`; return them best first."""
    problem = comparison.problem
    p, scales = problem.parameters, np.array(problem.parameters.refinement.coarse_scales())
    cdef double[3] step
    cdef Equations sums
    cdef Pose pose
    if problem.prior is not None:
        exempt, others = candidates
        if len(others) > p.selection.preselected:
            others = preselect(others, points, problem.reference.free_space, p.selection, p.density)
        return improved(comparison, table_of(np.concatenate((exempt, others))), comparison.own, scales, False)
    cdef PointViews some = views_of(sample(points, p.selection.preselection_points))
    cdef double[:, ::1] coarse = table_of(candidates.joined())
    coarse = supported(comparison, coarse, some, p.refinement.coarse_scale, p.selection.min_support_ratio)
    coarse = improved(comparison, coarse, some, scales, False)
    # One more step by all points: where the best has not converged, all are refined once more.
    read_pose(coarse, 0, &pose)
    add_points(comparison.own, comparison.field, &pose, comparison.min_cosine, p.refinement.fine_scale, &sums)
    solve_step(&sums, comparison.damping, step)
    if length_of(step[0], step[1]) < p.refinement.final_scale:
        return coarse
    again = improved(comparison, coarse.copy(), comparison.own, scales, False)
    return best_first(np.concatenate((coarse, again)))


cdef double[:, ::1] supported(Comparison comparison, const double[:, ::1] rows, PointViews views, double scale,
                              double min_ratio):
    """Return the hypotheses with at least `min_ratio` of the best one's support by a kernel of `scale` (Eq. 16)."""
    cdef double[::1] support = np.zeros(rows.shape[0])
    cdef Py_ssize_t[::1] kept = np.empty(rows.shape[0], np.intp)
    cdef double factor = -0.5 / (scale * scale), e, most = 0.0
    cdef Py_ssize_t h, k, count = 0
    cdef Match found
    cdef Pose pose
    with nogil:
        for h in range(rows.shape[0]):
            read_pose(rows, h, &pose)
            for k in range(views.size):
                match_point(views, comparison.field, k, &pose, comparison.min_cosine, &found)
                if found.alike:
                    e = found.error * views.inverse_noise[k]
                    support[h] += exp(factor * e * e)
            most = max(most, support[h])
        for h in range(rows.shape[0]):
            if support[h] >= min_ratio * most:
                kept[count] = h
                count += 1
    return chosen_rows(rows, kept, count)


cdef double[:, ::1] rank_finely(Comparison comparison, const double[:, ::1] coarse):
    """Refine the top candidates with a kernel that narrows to `refinement.final_scale`, and compare them both ways."""
    p = comparison.problem.parameters
    cdef double[:, ::1] top = top_candidates(comparison, coarse), close = with_shifted(comparison, top)
    scales = np.array(p.refinement.fine_scales())
    if close.shape[0] > 1:
        return improved(comparison, close, comparison.own, scales, True)
    if not p.refinement.polish_iterations:
        # Only the pose is replaced.
        refine_poses(comparison.own, comparison.field, comparison.min_cosine, comparison.damping, scales, close)
        top[0, :SCORE] = close[0, :SCORE]
    return top


cdef double[:, ::1] top_candidates(Comparison comparison, const double[:, ::1] coarse):
    """Return the hypotheses that are compared finely, most plausible first: the best, and rivals of it."""
    p = comparison.problem.parameters
    s, d = p.selection, p.decision
    cdef Py_ssize_t size = coarse.shape[0], h, count = 0
    cdef Py_ssize_t[:, ::1] work = np.empty((2, size), np.intp)
    cdef unsigned char[::1] chosen = np.zeros(size, np.uint8)
    cdef double[:, ::1] value = np.zeros((2, size))
    cdef double gap = s.max_score_gap
    if choose_distinct(coarse, size, 2, s.same_distance, s.same_angle, chosen) == 1:
        work[0, 0] = 0
        return chosen_rows(coarse, work[0], 1)
    add_reverse_conflicts(comparison, coarse, value[0])
    for h in range(size):
        # Negative: the most plausible come first.
        value[1, h] = -(coarse[h, SCORE] - sqrt(coarse[h, CONFLICT]) - sqrt(value[0, h]))
    sort_up_to_rounding(value[1], work[0], work[1])
    while count < size and value[1, work[0, count]] <= value[1, work[0, 0]] + gap:
        count += 1
    cdef double[:, ::1] ranked = chosen_rows(coarse, work[0], count)
    chosen[:] = False
    choose_distinct(ranked, count, s.top_candidates, s.same_distance, s.same_angle, chosen)
    choose_distinct(ranked, count, 1 + RIVALS, d.rival_distance, d.rival_angle, chosen)
    count = 0
    for h in range(ranked.shape[0]):
        if chosen[h]:
            work[0, count] = h
            count += 1
    return chosen_rows(ranked, work[0], count)


cdef Py_ssize_t choose_distinct(const double[:, ::1] poses, Py_ssize_t size, Py_ssize_t count, double most_apart,
                                double angle, unsigned char[::1] chosen) except -1:
    """Choose the first `count` hypotheses that differ from all chosen before, by a distance or an angle; count them."""
    cdef Py_ssize_t k, i, found = 0
    cdef Py_ssize_t[::1] index = np.empty(max(count, 1), np.intp)
    cdef bint differs
    for k in range(size):
        if found == count:
            break
        differs = True
        for i in range(found):
            if (length_of(poses[k, 0] - poses[index[i], 0], poses[k, 1] - poses[index[i], 1]) <= most_apart
                    and fabs(wrap(poses[k, 2] - poses[index[i], 2])) <= angle):
                differs = False
                break
        if differs:
            index[found], chosen[k] = k, True
            found += 1
    return found


cdef double[:, ::1] with_shifted(Comparison comparison, const double[:, ::1] rows):
    """Return the hypotheses, and for each with a degenerate direction a better one along it, where there is one."""
    cdef double ratio = comparison.problem.parameters.degeneracy.information_ratio
    cdef const double[::1] e
    cdef Weakest weakest
    cdef Py_ssize_t h
    cdef list degenerate = [], angles = []
    for h in range(rows.shape[0]):
        e = rows[h, EQUATIONS:]
        weakest = weakest_direction(e[0], e[1], e[2], e[5], e[6], e[10])
        if weakest.weak < ratio * weakest.strong:
            degenerate.append(h)
            angles.append(weakest.angle)
    poses = np.asarray(rows)[:, :SCORE]
    if not degenerate:
        return table_of(poses)
    candidates = poses[degenerate]
    shifted = search_along(comparison, candidates, np.array(angles))
    return table_of(np.concatenate((poses, shifted[(np.abs(shifted - candidates) > TINY).any(axis=1)])))


cdef double[:, ::1] improved(Comparison comparison, double[:, ::1] rows, PointViews views, const double[::1] scales,
                             bint both_ways):
    """Refine all hypotheses by some points of the current scan, and rank them by all sampled points."""
    problem = comparison.problem
    cdef double[::1] reverse
    cdef Py_ssize_t h
    refine_poses(views, comparison.field, comparison.min_cosine, comparison.damping, scales, rows)
    write_scores(comparison, comparison.own, rows)
    if both_ways:
        reverse = np.zeros(rows.shape[0])
        add_reverse_conflicts(comparison, rows, reverse)
        for h in range(rows.shape[0]):
            rows[h, SCORE] -= comparison.against * reverse[h]
    if problem.prior is not None:
        rows = subtract_prior(problem.prior, problem.parameters.prior, rows)
    return best_first(rows)


cdef double[:, ::1] subtract_prior(prior, parameters, double[:, ::1] rows):
    """Subtract the squared Mahalanobis distance from the prior, at most its gate, times `prior.weight`.

    The nearest to the prior become the first, so that they are the first of equal scores.
    """
    expected = prior.transform
    cdef double x0 = expected.x, y0 = expected.y, t0 = expected.theta, c = cos(t0), s = sin(t0), x, y
    cdef double gate = parameters.gate, weight = parameters.weight
    cdef const double[:, ::1] covariance = np.ascontiguousarray(prior.covariance, dtype=float)
    cdef Py_ssize_t h
    cdef double[3] error
    cdef double[::1] distance = np.empty(rows.shape[0])
    cdef Py_ssize_t[:, ::1] work = np.empty((2, rows.shape[0]), np.intp)
    for h in range(rows.shape[0]):
        x, y = rows[h, 0] - x0, rows[h, 1] - y0
        error[0], error[1], error[2] = c * x + s * y, c * y - s * x, wrap(rows[h, 2] - t0)
        distance[h] = squared_distance(covariance, error) / (gate * gate)
        rows[h, SCORE] -= weight * min(distance[h], 1.0)
    sort_up_to_rounding(distance, work[0], work[1])
    return chosen_rows(rows, work[0], rows.shape[0])


def preselect(candidates, points, profile, parameters, density):
    """Return the hypotheses that align a scan best with the outline of the reference, at most `selection.preselected`.

    Only the free-space profile of the reference is looked up, not its likelihood field.

    Parameters
    ----------
    candidates : (C, 3) array
    points : OrientedPoints
        Points of the current scan.
    profile : FreeSpaceProfile
        Free-space profile of the reference.
    parameters : SelectionParameters
    density : DensityParameters
    """
    if len(candidates) <= parameters.preselected:
        return candidates
    places = transform_points(candidates, sample(points, parameters.preselection_points).points)
    bins, radius = profile.bins(places), np.abs(places)
    near, far = profile.near.take(bins), profile.far.take(bins)
    off = np.maximum(near - radius, radius - far)
    support = np.minimum(np.maximum(1.0 - off / parameters.preselection_tolerance, 0.0), 1.0)
    support *= near > 0.0
    support -= density.violation_weight * in_front(radius, near, parameters.preselection_tolerance)
    return candidates[order_up_to_rounding(-support.sum(axis=1))[:parameters.preselected]]
