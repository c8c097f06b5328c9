# SPDX-License-Identifier: Apache-2.0
"""Refinement and ranking of hypotheses, as `core.registration.selection`."""


cdef class Comparison:
    """What hypotheses are compared by: both scans, and parameters as numbers."""

    cdef object problem
    cdef Lines field
    cdef PointViews own
    cdef const double[::1] share, near
    cdef double min_cosine, damping, score_scale, tolerance, against

    def __cinit__(self, problem):
        p, current = problem.parameters, problem.current
        self.problem, self.field = problem, lines_of(problem.reference.likelihood_field)
        self.own, self.share = views_of(current.sampled_points), current.leverage
        self.near = problem.reference.free_space.near
        self.min_cosine, self.damping = p.density.min_normal_cosine, p.refinement.damping
        self.score_scale, self.tolerance = p.refinement.score_scale, p.density.violation_tolerance
        self.against = p.density.violation_weight


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
    ranked = rank_coarsely(comparison, candidates, points)
    if ranked[1][0] > min_score:
        ranked = rank_finely(comparison, ranked)
    return Ranking(*ranked, np.zeros(len(ranked[0])),
                   fit(ranked[0][:1], points, problem.reference.likelihood_field, comparison.min_cosine))


def polish_best(problem, fine):
    """Refine the best hypothesis by all oriented points, with a kernel that narrows to the spread of their errors."""
    p, current, points, best = problem.parameters, problem.current, problem.current.sampled_points, fine.best
    if p.refinement.polish_iterations and current.oriented_points is not points:
        points = current.oriented_points
        best = fit(fine.candidates[:1], points, problem.reference.likelihood_field, p.density.min_normal_cosine)
    candidate, best = polish(fine.candidates[0], best, points, p.refinement)
    return fine.with_best(candidate, best.thinned(p.density.max_points))


cdef rank_coarsely(Comparison comparison, candidates, points):
    """Refine hypotheses with a kernel that narrows from `refinement.coarse_scale`; return arrays, best first."""
    problem = comparison.problem
    p, scales = problem.parameters, np.array(problem.parameters.refinement.coarse_scales())
    cdef double[3] step
    cdef Equations sums
    cdef Pose pose
    if problem.prior is not None:
        others = candidates.others
        if len(others) > p.selection.preselected:
            others = scoring_steps.preselect(others, points, problem.reference.free_space, p.selection, p.density)
        return improved(comparison, np.concatenate((candidates.exempt, others)), comparison.own, scales, False)
    cdef PointViews some = views_of(oriented_steps.sample(points, p.selection.preselection_points))
    start = supported(comparison, candidates.joined(), some, p.refinement.coarse_scale, p.selection.min_support_ratio)
    coarse = improved(comparison, start, some, scales, False)
    # One more step by all points: where the best has not converged, all are refined once more.
    read_pose(coarse[0], 0, &pose)
    add_points(comparison.own, comparison.field, &pose, comparison.min_cosine, p.refinement.fine_scale, &sums)
    solve_step(&sums, comparison.damping, step)
    if length_of(step[0], step[1]) < p.refinement.final_scale:
        return coarse
    again = improved(comparison, coarse[0], comparison.own, scales, False)
    both = [np.concatenate(each) for each in zip(coarse, again)]
    order = (-both[1]).argsort(kind='stable')
    return tuple([part[order] for part in both])


cdef supported(Comparison comparison, candidates, PointViews views, double scale, double min_ratio):
    """Return the hypotheses with at least `min_ratio` of the best one's support by a kernel of `scale` (Eq. 16)."""
    supports = np.zeros(len(candidates))
    cdef double[:, ::1] poses = candidates
    cdef double[::1] support = supports
    cdef double factor = -0.5 / (scale * scale), e
    cdef Py_ssize_t h, k
    cdef Match found
    cdef Pose pose
    with nogil:
        for h in range(poses.shape[0]):
            read_pose(poses, h, &pose)
            for k in range(views.size):
                match_point(views, comparison.field, k, &pose, comparison.min_cosine, &found)
                if found.alike:
                    e = found.error * views.inverse_noise[k]
                    support[h] += exp(factor * e * e)
    return candidates[supports >= min_ratio * supports.max()]


cdef rank_finely(Comparison comparison, coarse):
    """Refine the top candidates with a kernel that narrows to `refinement.final_scale`, and compare them both ways."""
    p = comparison.problem.parameters
    top = top_candidates(comparison, coarse)
    close = with_shifted(comparison, top[0], top[4])
    scales = np.array(p.refinement.fine_scales())
    if len(close) > 1:
        return improved(comparison, close, comparison.own, scales, True)
    if not p.refinement.polish_iterations:
        refine_poses(comparison.own, comparison.field, comparison.min_cosine, comparison.damping, scales, close,
                     np.empty((1, 4, 4)))
        top[0][0] = close[0]
    return top


cdef top_candidates(Comparison comparison, coarse):
    """Return the hypotheses that are compared finely, most plausible first: the best, and rivals of it."""
    p = comparison.problem.parameters
    s, d = p.selection, p.decision
    if choose_distinct(coarse[0], 2, s.same_distance, s.same_angle, np.zeros(len(coarse[0]), dtype=bool)) == 1:
        return [part[:1] for part in coarse]
    value = coarse[1] - np.sqrt(coarse[3]) - np.sqrt(reverse_conflicts(comparison, coarse[0]))
    order = (-value).argsort(kind='stable')
    order = order[value[order] >= value[order[0]] - s.max_score_gap]
    ranked, chosen = [part[order] for part in coarse], np.zeros(len(order), dtype=bool)
    choose_distinct(ranked[0], s.top_candidates, s.same_distance, s.same_angle, chosen)
    choose_distinct(ranked[0], 1 + selection_steps._RIVALS, d.rival_distance, d.rival_angle, chosen)
    return [part[chosen] for part in ranked]


cdef int choose_distinct(const double[:, ::1] poses, Py_ssize_t count, double most_apart, double angle,
                         unsigned char[::1] chosen) except -1:
    """Choose the first `count` hypotheses that differ from all chosen before, by a distance or an angle; count them."""
    cdef Py_ssize_t k, i, found = 0
    cdef Py_ssize_t[::1] index = np.empty(max(count, 1), np.intp)
    cdef bint differs
    for k in range(poses.shape[0]):
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


cdef with_shifted(Comparison comparison, candidates, equations):
    """Return the hypotheses, and for each with a degenerate direction a better one along it, where there is one."""
    cdef double[:, :, ::1] tables = equations
    cdef double ratio = comparison.problem.parameters.degeneracy.information_ratio
    cdef Weakest weakest
    cdef Py_ssize_t h
    flags, angles = np.zeros(len(candidates), dtype=bool), np.empty(len(candidates))
    for h in range(tables.shape[0]):
        read_weakest(tables[h], &weakest)
        flags[h], angles[h] = weakest.weak < ratio * weakest.strong, weakest.angle
    if not flags.any():
        return candidates
    shifted = search_along(comparison, candidates[flags], angles[flags])
    return np.concatenate((candidates, shifted[(np.abs(shifted - candidates[flags]) > TINY).any(axis=1)]))


cdef improved(Comparison comparison, candidates, PointViews views, const double[::1] scales, bint both_ways):
    """Refine all hypotheses by some points of the current scan, and rank them by all sampled points; return arrays."""
    problem, poses, count = comparison.problem, np.array(candidates), len(candidates)
    values, overlaps, lost, tables = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros((count, 4, 4))
    refine_poses(views, comparison.field, comparison.min_cosine, comparison.damping, scales, poses, tables)
    add_scores(comparison, comparison.own, poses, values, overlaps, lost)
    if both_ways:
        values -= comparison.against * reverse_conflicts(comparison, poses)
    if problem.prior is not None:
        subtract_prior(problem.prior, poses, problem.parameters.prior, values)
    order = (-values).argsort(kind='stable')
    return poses[order], values[order], overlaps[order], lost[order], tables[order]


cdef int add_scores(Comparison comparison, PointViews views, const double[:, ::1] poses, double[::1] value,
                    double[::1] overlap, double[::1] conflict) except -1 nogil:
    """Add score, overlap and conflict of each hypothesis by the current scan's points, as `scoring.score`."""
    cdef double factor = -0.5 / (comparison.score_scale * comparison.score_scale), weight, lost, e
    cdef Py_ssize_t h, k
    cdef Match found
    cdef Pose pose
    for h in range(poses.shape[0]):
        read_pose(poses, h, &pose)
        for k in range(views.size):
            match_point(views, comparison.field, k, &pose, comparison.min_cosine, &found)
            # Gaussian kernel (Eq. 18), 0 where the normals disagree.
            e = found.error * views.inverse_noise[k]
            weight = exp(factor * e * e) if found.alike else 0.0
            lost = violation(comparison.near, found.x + pose.x, found.y + pose.y,
                             comparison.tolerance / views.inverse_noise[k])
            value[h] += (weight - comparison.against * lost * (1.0 - weight)) * comparison.share[k]
            overlap[h] += weight
            conflict[h] += lost * comparison.share[k]
        overlap[h] /= <double> max(views.size, 1)
    return 0


cdef reverse_conflicts(Comparison comparison, const double[:, ::1] poses):
    """Return the weighted fraction ``(H,)`` of the reference's points in free space of the current scan."""
    reference = comparison.problem.reference
    cdef PointViews views = views_of(reference.sampled_points)
    cdef const double[::1] near = comparison.problem.current.free_space.near, share = reference.leverage
    cdef Py_ssize_t h, k
    cdef double x, y
    cdef Pose pose
    fractions = np.zeros(poses.shape[0])
    cdef double[::1] fraction = fractions
    with nogil:
        for h in range(poses.shape[0]):
            read_pose(poses, h, &pose)
            for k in range(views.size):
                x, y = views.points[k].real - pose.x, views.points[k].imag - pose.y
                fraction[h] += share[k] * violation(near, pose.c * x + pose.s * y, pose.c * y - pose.s * x,
                                                    comparison.tolerance / views.inverse_noise[k])
    return fractions


cdef int subtract_prior(prior, const double[:, ::1] poses, parameters, double[::1] value) except -1:
    """Subtract the squared Mahalanobis distance from the prior, at most its gate, times `prior.weight`."""
    expected = prior.transform
    cdef double x0 = expected.x, y0 = expected.y, t0 = expected.theta, c = cos(t0), s = sin(t0), x, y
    cdef double gate = parameters.gate, weight = parameters.weight
    cdef const double[:, ::1] covariance = np.ascontiguousarray(prior.covariance, dtype=float)
    cdef Py_ssize_t h
    cdef double[3] error
    for h in range(poses.shape[0]):
        x, y = poses[h, 0] - x0, poses[h, 1] - y0
        error[0], error[1], error[2] = c * x + s * y, c * y - s * x, wrap(poses[h, 2] - t0)
        value[h] -= weight * min(squared_distance(covariance, error) / (gate * gate), 1.0)
    return 0
