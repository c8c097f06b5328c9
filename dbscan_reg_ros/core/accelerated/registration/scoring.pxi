# SPDX-License-Identifier: Apache-2.0
"""Scores of hypotheses, and which of them differ (section 2.3)."""


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


cdef int write_scores(Comparison comparison, PointViews views, double[:, ::1] rows) except -1 nogil:
    """Write score, overlap and conflict of each hypothesis by the current scan's points.

    The score is the weighted fraction of the points on the reference's surfaces, less `violation_weight` times the
    weighted fraction in its free space; the overlap is the unweighted fraction on the surfaces, and the conflict the
    weighted fraction in free space.
    """
    cdef double factor = -0.5 / (comparison.score_scale * comparison.score_scale), weight, lost, e
    cdef double value, overlap, conflict
    cdef Py_ssize_t h, k
    cdef Match found
    cdef Pose pose
    for h in range(rows.shape[0]):
        read_pose(rows, h, &pose)
        value = overlap = conflict = 0.0
        for k in range(views.size):
            match_point(views, comparison.field, k, &pose, comparison.min_cosine, &found)
            # Gaussian kernel (Eq. 18), 0 where the normals disagree.
            e = found.error * views.inverse_noise[k]
            weight = exp(factor * e * e) if found.alike else 0.0
            lost = violation(comparison.near, found.x + pose.x, found.y + pose.y,
                             comparison.tolerance / views.inverse_noise[k])
            value += (weight - comparison.against * lost * (1.0 - weight)) * comparison.share[k]
            overlap += weight
            conflict += lost * comparison.share[k]
        rows[h, SCORE], rows[h, OVERLAP], rows[h, CONFLICT] = value, overlap / <double> max(views.size, 1), conflict
    return 0


def scores(problem, candidates):
    """Return score, overlap and conflict ``(H,)`` of each of the hypotheses ``(H, 3)``, as a `Ranking` has them."""
    cdef Comparison comparison = Comparison(problem)
    cdef double[:, ::1] rows = table_of(candidates)
    write_scores(comparison, comparison.own, rows)
    return tuple(np.asarray(rows).T[SCORE:EQUATIONS].copy())


def reverse_conflicts(problem, candidates):
    """Return the weighted fraction ``(H,)`` of the reference's points in free space of the current scan."""
    fraction = np.zeros(len(candidates))
    add_reverse_conflicts(Comparison(problem), table_of(candidates), fraction)
    return fraction


cdef int add_reverse_conflicts(Comparison comparison, const double[:, ::1] poses, double[::1] fraction) except -1:
    """Add the weighted fraction of the reference's points in free space of the current scan, of each hypothesis."""
    reference = comparison.problem.reference
    cdef PointViews views = views_of(reference.sampled_points)
    cdef const double[::1] near = comparison.problem.current.free_space.near, share = reference.leverage
    cdef Py_ssize_t h, k
    cdef double x, y
    cdef Pose pose
    with nogil:
        for h in range(poses.shape[0]):
            read_pose(poses, h, &pose)
            for k in range(views.size):
                x, y = views.points[k].real - pose.x, views.points[k].imag - pose.y
                fraction[h] += share[k] * violation(near, pose.c * x + pose.s * y, pose.c * y - pose.s * x,
                                                    comparison.tolerance / views.inverse_noise[k])
    return 0
