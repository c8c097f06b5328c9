# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Point-to-line correspondences and robust iterations (Eq. 16-18)."""
import numpy as np

from ..parameters import registration as constants

cimport cython
from libc.stdlib cimport free, malloc
from libc.string cimport memcpy

from ..features.oriented_points cimport BLOCK, OrientedPoints
from ..features.point_weights cimport kernel, kernel_factor
from .views cimport FieldArrays, Grid, Lines, clipped, lines_of, point_of

cdef double MIN_NORMAL_COSINE = constants.MIN_NORMAL_COSINE
cdef Equations NO_POINTS = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


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
        if self.size:
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
            self.rows[self.size + h] = Hypothesis(motions[h, 0], motions[h, 1], motions[h, 2], 0.0, 0.0, 0.0, 0.0,
                                                  NO_POINTS)
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

    @property
    def candidates(self):
        """``(H, 3)`` motions [m, m, rad]."""
        return self.motions()

    @property
    def best_score(self):
        """Score of the first; penalties are subtracted."""
        return self.rows[0].score

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
    points, field, damping = alignment
    cdef Hypotheses found = Hypotheses(candidates)
    refine_hypotheses(points, lines_of(field), damping, np.array(scales, dtype=float), found)
    equations = np.empty((found.size, 4, 4))
    cdef double[:, :, ::1] table = equations
    cdef Py_ssize_t h
    for h in range(found.size):
        write_equations(&found.rows[h].equations, &table[h, 0, 0])
    return found.motions(), equations


cdef int refine_hypotheses(OrientedPoints points, Lines field, double damping, const double[::1] scales,
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
            add_points(points, field, &pose, scales[level], &row.equations)
            solve_step(&row.equations, damping, step)
            row.x, row.y, row.theta = row.x - step[0], row.y - step[1], row.theta - step[2]
    return 0


@cython.boundscheck(False)
cdef void match_points(OrientedPoints points, Lines lines, Py_ssize_t first, Pose *pose,
                       Matches *found) noexcept nogil:
    """Match a block of points, from the `first`, to the lines of the reference that are nearest to them at a pose.

    No index is checked: arrays of points have one length, and `Lines` hold a valid table.
    """
    cdef const double *point = <const double *> &points.points_view[first]
    cdef const double *normal = <const double *> &points.normals_view[first]
    cdef const double *inverse_noise = &points.inverse_noise_view[first]
    cdef FieldArrays *field = &lines.arrays
    cdef Grid grid = field.grid
    cdef Pose at = pose[0]
    cdef Py_ssize_t size = min(BLOCK, points.size - first), k, nearest
    cdef double last_row = grid.rows - 1, last_column = grid.columns - 1, least = MIN_NORMAL_COSINE, x, y, nx, ny, cosine
    found.size = size
    # p_R = Rot(theta) p_O + t (Eq. 8)
    for k in range(size):
        x, y = at.c * point[2 * k] - at.s * point[2 * k + 1], at.s * point[2 * k] + at.c * point[2 * k + 1]
        found.x[k], found.y[k] = x, y
        found.row[k] = clipped((x + at.x - grid.x) * grid.inverse_cell, last_row)
        found.column[k] = clipped((y + at.y - grid.y) * grid.inverse_cell, last_column)
    for k in range(size):
        nearest = point_of(field, found.row[k], found.column[k])
        found.nx[k], found.ny[k] = field.normals[nearest].real, field.normals[nearest].imag
        found.error[k] = field.offsets[nearest]
    # The normal is conjugated: its product with a point has the distance from the line as the real part.
    for k in range(size):
        x, y, nx, ny = found.x[k] + at.x, found.y[k] + at.y, found.nx[k], found.ny[k]
        cosine = (nx * (at.c * normal[2 * k] - at.s * normal[2 * k + 1])
                  - ny * (at.s * normal[2 * k] + at.c * normal[2 * k + 1]))
        # The normal of no point is 0.
        found.alike[k] = (1.0 if nx * nx + ny * ny > 0.0 else 0.0) * (1.0 if cosine > least else 0.0)
        found.error[k] = (nx * x - ny * y - found.error[k]) * inverse_noise[k]
        found.nx[k], found.ny[k] = nx * inverse_noise[k], ny * inverse_noise[k]


cdef void weigh(Matches *found, double scale) noexcept nogil:
    """Weigh the points by a Gaussian kernel of `scale` [m] (Eq. 18), 0 where the normals disagree."""
    cdef double factor = kernel_factor(scale)
    cdef Py_ssize_t size = found.size, k
    for k in range(size):
        found.weight[k] = found.alike[k] * kernel(found.error[k], factor)


@cython.boundscheck(False)
cdef int add_points(OrientedPoints points, Lines field, Pose *pose, double scale, Equations *sums) except -1 nogil:
    """Write the normal equations of all points at a pose, weighted by a kernel of `scale` [m]."""
    cdef Py_ssize_t first, k
    cdef const double *weights
    cdef Matches found
    cdef Equations total = NO_POINTS
    first = 0
    while first < points.size:
        match_points(points, field, first, pose, &found)
        weigh(&found, scale)
        weights = &points.weights_view[first]
        for k in range(found.size):
            # The Jacobian is (nx, -ny, -Im(n p)).
            add_row(&total, found.weight[k] * weights[k], found.nx[k], -found.ny[k],
                    -(found.nx[k] * found.y[k] + found.ny[k] * found.x[k]), found.error[k])
        first += BLOCK
    sums[0] = total
    return 0
