# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Point-to-line correspondences and robust iterations (Eq. 16-18)."""
import numpy as np

from ..geometry import tolerance
from .residuals import Fit

from libc.math cimport exp, sqrt

from ..features.oriented_points cimport given_or_ones
from ..geometry.plane cimport length_of
from .views cimport Lines, PointViews, lines_of, views_of

cdef double TINY = tolerance.TINY


def fit(candidates, points, field, double min_normal_cosine):
    """Find the `Fit` of a scan's points to the reference.

    Parameters
    ----------
    candidates : (H, 3) array
    points : OrientedPoints
        Of the current scan.
    field : LikelihoodField
        Of the reference.
    min_normal_cosine : float
        Minimum cosine of the angle between corresponding normals.
    """
    cdef const double[:, ::1] poses = np.ascontiguousarray(candidates)
    cdef PointViews views = views_of(points)
    cdef Lines lines = lines_of(field)
    cdef Py_ssize_t h, k
    cdef Match found
    cdef Pose pose
    shape = poses.shape[0], views.size
    errors, alikes = np.empty(shape), np.empty(shape, dtype=bool)
    normals, rotated, places = np.empty(shape, complex), np.empty(shape, complex), np.empty(shape, complex)
    cdef double[:, ::1] error = errors
    cdef unsigned char[:, ::1] alike = alikes
    cdef double complex[:, ::1] normal = normals, turned = rotated, place = places
    with nogil:
        for h in range(poses.shape[0]):
            read_pose(poses, h, &pose)
            for k in range(views.size):
                match_point(views, lines, k, &pose, min_normal_cosine, &found)
                turned[h, k], place[h, k] = found.x + 1j * found.y, (found.x + pose.x) + 1j * (found.y + pose.y)
                normal[h, k] = (found.nx + 1j * found.ny) * views.inverse_noise[k]
                error[h, k], alike[h, k] = found.error * views.inverse_noise[k], found.alike
    return Fit(errors, alikes, normals, rotated, places)


cdef double[:, ::1] table_of(candidates):
    """Return a table of hypotheses ``(H, 3)``, without scores."""
    cdef const double[:, :] poses = candidates
    cdef double[:, ::1] rows = np.zeros((poses.shape[0], COLUMNS))
    cdef Py_ssize_t h, k
    for h in range(poses.shape[0]):
        for k in range(SCORE):
            rows[h, k] = poses[h, k]
    return rows


def refine(candidates, alignment, scales):
    """Refine candidates in robust point-to-line iterations, one iteration per entry of `scales` [m].

    Parameters
    ----------
    candidates : (H, 3) array
    alignment : Alignment
    scales : sequence of float [m]
        Scale of the robust kernel in each iteration.

    Returns
    -------
    candidates : (H, 3) array
    equations : (H, 4, 4) array
        The normal equations of the last iteration.
    """
    points, field, min_cosine, damping = alignment
    cdef double[:, ::1] rows = table_of(candidates)
    refine_poses(views_of(points), lines_of(field), min_cosine, damping, np.array(scales, dtype=float), rows)
    table = np.asarray(rows)
    return table[:, :SCORE].copy(), table[:, EQUATIONS:].reshape(len(table), 4, 4)


cdef int refine_poses(PointViews views, Lines field, double min_cosine, double damping, const double[::1] scales,
                      double[:, ::1] poses) except -1:
    """Refine a table of hypotheses in place, and write the normal equations of the last iteration to it."""
    cdef Py_ssize_t h, k, level
    cdef double[3] step
    cdef Equations sums
    cdef Pose pose
    with nogil:
        for h in range(poses.shape[0]):
            sums = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            for level in range(scales.shape[0]):
                read_pose(poses, h, &pose)
                add_points(views, field, &pose, min_cosine, scales[level], &sums)
                solve_step(&sums, damping, step)
                for k in range(3):
                    poses[h, k] -= step[k]
            write_equations(&sums, &poses[h, EQUATIONS])
    return 0


cdef int add_points(PointViews views, Lines field, Pose *pose, double min_cosine, double scale,
                    Equations *sums) except -1 nogil:
    """Write the normal equations of all points at a pose, weighted by a kernel of `scale` [m]."""
    cdef double factor = -0.5 / (scale * scale), e, nx, ny
    cdef Py_ssize_t k
    cdef Match found
    sums[0] = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(views.size):
        match_point(views, field, k, pose, min_cosine, &found)
        if found.alike:
            # Error and Jacobian (nx, -ny, -Im(n p)), times the inverse noise scale; Gaussian kernel (Eq. 18).
            e, nx, ny = (found.error * views.inverse_noise[k], found.nx * views.inverse_noise[k],
                         found.ny * views.inverse_noise[k])
            add_row(sums, exp(factor * e * e) * views.weights[k], nx, -ny, -(nx * found.y + ny * found.x), e)
    return 0


def polish(candidate, found, points, refinement):
    """Refine one candidate ``(3,)`` with a kernel that narrows to the spread of the errors.

    The correspondences of `found`, the candidate's `Fit`, are kept, so the errors are linear in the step. A candidate
    that moves farther than the first kernel, as it may along a corridor, is returned unchanged.

    Returns
    -------
    candidate : (3,) array
    found : Fit
        Of it, H = 1.
    """
    if not refinement.polish_iterations:
        return candidate, found
    errors = found.error.copy()
    cdef double[:, ::1] error = errors
    cdef const unsigned char[:, ::1] alike = found.alike
    cdef const double complex[:, ::1] normal = found.normals, rotated = found.rotated_points
    cdef const double[::1] weights = given_or_ones(points.weights, error.shape[1])
    cdef double scale = refinement.final_scale, damping = refinement.damping, factor, weight, sum_weight, e
    cdef Py_ssize_t k
    cdef Equations sums
    cdef double[3] step
    cdef double[3] total = [0.0, 0.0, 0.0]
    for _ in range(refinement.polish_iterations):
        sums, sum_weight = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0
        factor = -0.5 / (scale * scale)
        for k in range(error.shape[1]):
            if alike[0, k]:
                e = error[0, k]
                weight = exp(factor * e * e) * weights[k]
                sum_weight += weight
                add_row(&sums, weight, normal[0, k].real, -normal[0, k].imag,
                        -product_imag(normal[0, k], rotated[0, k]), e)
        solve_step(&sums, damping, step)
        scale = refinement.narrowed(scale, sqrt(sums.e / max(sum_weight, 1e-9)))
        for k in range(3):
            total[k] += step[k]
        for k in range(error.shape[1]):
            error[0, k] -= (step[0] * normal[0, k].real - step[1] * normal[0, k].imag
                            - step[2] * product_imag(normal[0, k], rotated[0, k]))
    if length_of(total[0], total[1]) >= refinement.final_scale:
        return candidate, found
    return candidate - np.array((total[0], total[1], total[2])), found._replace(error=errors)


def polish_best(problem, fine):
    """Refine the best hypothesis by all oriented points, with a kernel that narrows to the spread of their errors."""
    p, current, points, best = problem.parameters, problem.current, problem.current.sampled_points, fine.best
    if p.refinement.polish_iterations and current.oriented_points is not points:
        points = current.oriented_points
        best = fit(fine.candidates[:1], points, problem.reference.likelihood_field, p.density.min_normal_cosine)
    if best is fine.best and not p.refinement.polish_iterations and len(points) <= p.density.max_points:
        return fine
    candidate, best = polish(fine.candidates[0], best, points, p.refinement)
    return fine.with_best(candidate, best.thinned(p.density.max_points))
