# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Point-to-line correspondences and robust iterations (Eq. 16-18)."""
import numpy as np

from ..geometry import tolerance
from .residuals import Fit

cimport cython
from libc.math cimport sqrt
from libc.stdlib cimport free, malloc
from libc.string cimport memcpy

from ..features.oriented_points cimport OrientedPoints
from ..geometry.exponential cimport decaying_exp
from ..geometry.plane cimport length_of
from .views cimport Lines, lines_of

cdef double TINY = tolerance.TINY
cdef Equations NO_POINTS = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def fit(candidates, OrientedPoints points, field, double min_normal_cosine):
    """Find the `Fit` of a scan's P points to the reference: arrays ``(H, P)``.

    Parameters
    ----------
    candidates : (H, 3) array [m, m, rad]
    points : OrientedPoints
        Of the current scan.
    field : LikelihoodField
        Of the reference.
    min_normal_cosine : float
        Minimum cosine of the angle between corresponding normals.
    """
    cdef const double[:, ::1] poses = np.ascontiguousarray(candidates)
    cdef Lines lines = lines_of(field)
    cdef Py_ssize_t h, k
    cdef Match found
    cdef Pose pose
    shape = poses.shape[0], points.size
    errors, alikes = np.empty(shape), np.empty(shape, dtype=bool)
    normals, rotated, places = np.empty(shape, complex), np.empty(shape, complex), np.empty(shape, complex)
    cdef double[:, ::1] error = errors
    cdef unsigned char[:, ::1] alike = alikes
    cdef double complex[:, ::1] normal = normals, turned = rotated, place = places
    with nogil:
        for h in range(poses.shape[0]):
            pose = pose_at(poses[h, 0], poses[h, 1], poses[h, 2])
            for k in range(points.size):
                match_point(points, lines, k, &pose, min_normal_cosine, &found)
                turned[h, k], place[h, k] = found.x + 1j * found.y, (found.x + pose.x) + 1j * (found.y + pose.y)
                normal[h, k] = (found.nx + 1j * found.ny) * points.inverse_noise_view[k]
                error[h, k], alike[h, k] = found.error * points.inverse_noise_view[k], found.alike
    return Fit(errors, alikes, normals, rotated, places)


cdef class Hypotheses:
    """Hypotheses of a motion, and the work of sorting and choosing them."""

    def __cinit__(self, exempt, others=()):
        self.reserve(max(len(exempt) + len(others), 1))
        for motions in (exempt, others):
            if len(motions):
                self.add(motions)

    def __dealloc__(self):
        free(self.block)

    cdef int reserve(self, Py_ssize_t most) except -1:
        """Make place for at least this many hypotheses."""
        cdef Hypothesis *block
        if most <= self.most:
            return 0
        block = <Hypothesis *> malloc(2 * most * sizeof(Hypothesis))
        if block == NULL:
            raise MemoryError
        memcpy(block, self.rows, self.size * sizeof(Hypothesis))
        free(self.block)
        self.block, self.rows, self.spare, self.most = block, block, block + most, most
        self.number, self.index = np.empty((2, most)), np.empty((3, most), np.intp)
        return 0

    cdef int add(self, const double[:, :] motions) except -1:
        """Append motions ``(H, 3)``, without scores."""
        cdef Py_ssize_t h
        self.reserve(self.size + motions.shape[0])
        for h in range(motions.shape[0]):
            self.rows[self.size + h] = Hypothesis(motions[h, 0], motions[h, 1], motions[h, 2], 0.0, 0.0, 0.0, NO_POINTS)
        self.size += motions.shape[0]
        return 0

    cdef int select(self, const Py_ssize_t[::1] chosen, Py_ssize_t count) except -1 nogil:
        """Keep the rows with the first `count` of the `chosen` indices, in their order."""
        cdef Py_ssize_t h
        for h in range(count):
            if not 0 <= chosen[h] < self.size:
                raise IndexError('a hypothesis that is none')
            self.spare[h] = self.rows[chosen[h]]
        self.rows, self.spare, self.size = self.spare, self.rows, count
        return 0

    cdef motions(self):
        """Return the motions ``(H, 3)``."""
        cdef Py_ssize_t h
        motions = np.empty((self.size, 3))
        cdef double[:, ::1] motion = motions
        for h in range(self.size):
            motion[h, 0], motion[h, 1], motion[h, 2] = self.rows[h].x, self.rows[h].y, self.rows[h].theta
        return motions


def refine(candidates, alignment, scales):
    """Refine candidates in robust point-to-line iterations, one iteration per entry of `scales` [m].

    Parameters
    ----------
    candidates : (H, 3) array [m, m, rad]
    alignment : Alignment
    scales : sequence of float [m]
        Scale of the robust kernel in each iteration.

    Returns
    -------
    candidates : (H, 3) array [m, m, rad]
    equations : (H, 4, 4) array
        The normal equations of the last iteration.
    """
    points, field, min_cosine, damping = alignment
    cdef Hypotheses found = Hypotheses(candidates)
    refine_hypotheses(points, lines_of(field), min_cosine, damping, np.array(scales, dtype=float), found)
    equations = np.empty((found.size, 4, 4))
    cdef double[:, :, ::1] table = equations
    cdef Py_ssize_t h
    for h in range(found.size):
        write_equations(&found.rows[h].equations, &table[h, 0, 0])
    return found.motions(), equations


cdef int refine_hypotheses(OrientedPoints points, Lines field, double min_cosine, double damping, const double[::1] scales,
                           Hypotheses found) except -1 nogil:
    """Refine hypotheses in place, and keep the normal equations of their last iteration."""
    cdef Py_ssize_t h, level
    cdef double[3] step
    cdef Hypothesis *row
    cdef Pose pose
    for h in range(found.size):
        row = &found.rows[h]
        row.equations = NO_POINTS
        for level in range(scales.shape[0]):
            pose = pose_at(row.x, row.y, row.theta)
            add_points(points, field, &pose, min_cosine, scales[level], &row.equations)
            solve_step(&row.equations, damping, step)
            row.x, row.y, row.theta = row.x - step[0], row.y - step[1], row.theta - step[2]
    return 0


@cython.boundscheck(False)
cdef int add_points(OrientedPoints points, Lines field, Pose *pose, double min_cosine, double scale,
                    Equations *sums) except -1 nogil:
    """Write the normal equations of all points at a pose, weighted by a kernel of `scale` [m]."""
    cdef double factor = -0.5 / (scale * scale), e, nx, ny
    cdef Py_ssize_t k
    cdef Match found
    sums[0] = NO_POINTS
    for k in range(points.size):
        match_point(points, field, k, pose, min_cosine, &found)
        if found.alike:
            # Error and Jacobian (nx, -ny, -Im(n p)), times the inverse noise scale; Gaussian kernel (Eq. 18).
            e, nx, ny = (found.error * points.inverse_noise_view[k], found.nx * points.inverse_noise_view[k],
                         found.ny * points.inverse_noise_view[k])
            add_row(sums, decaying_exp(factor * e * e) * points.weights_view[k], nx, -ny,
                    -(nx * found.y + ny * found.x), e)
    return 0


def polish(candidate, found, OrientedPoints points, refinement):
    """Refine one candidate ``(3,)`` [m, m, rad] with a kernel (Eq. 18) that narrows to the spread of the errors.

    The correspondences of `found`, the candidate's `Fit`, are kept, so the errors are linear in the step. A candidate
    that moves farther than the first kernel, as it may along a corridor, is returned unchanged.

    Returns
    -------
    candidate : (3,) array [m, m, rad]
    found : Fit
        Of it, H = 1.
    """
    if not refinement.polish_iterations:
        return candidate, found
    errors = found.error.copy()
    cdef double[:, ::1] error = errors
    cdef const unsigned char[:, ::1] alike = found.alike
    cdef const double complex[:, ::1] normal = found.normals, rotated = found.rotated_points
    cdef const double[::1] weights = points.weights_view
    cdef double scale = refinement.final_scale, damping = refinement.damping, factor, weight, sum_weight, e
    cdef Py_ssize_t k
    cdef Equations sums
    cdef double[3] step
    cdef double[3] total = [0.0, 0.0, 0.0]
    for _ in range(refinement.polish_iterations):
        sums, sum_weight = NO_POINTS, 0.0
        factor = -0.5 / (scale * scale)
        for k in range(error.shape[1]):
            if alike[0, k]:
                e = error[0, k]
                weight = decaying_exp(factor * e * e) * weights[k]
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
