# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Correspondences of a scan's points with lines of the reference at one pose, and the last refinement by them."""
import numpy as np

from ..geometry import tolerance
from ..parameters import registration as scales

cimport cython
from libc.math cimport cos, sin, sqrt

from ..features.oriented_points cimport BLOCK, OrientedPoints
from ..features.point_weights cimport kernel, kernel_factor
from ..geometry.plane cimport length_of
from .point_to_line cimport Equations, Hypothesis, Matches, Pose, add_row, match_points, pose_at, solve_step
from .uncertainty cimport BY_THETA, BY_X, BY_Y, ERROR, OWN_THETA, OWN_X, OWN_Y, ROWS, WEIGHT
from .views cimport Lines, lines_of


cdef double TINY = tolerance.TINY, FINAL_SCALE = scales.FINAL_SCALE
cdef Equations NO_POINTS = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


cdef class Fit:
    """Correspondences of a scan's P points with lines of the reference, at one pose (Eq. 16-18).

    Attributes
    ----------
    residuals : (8, P) array
        The table of `match_covariance`; errors and derivatives are multiplied by the `inverse_noise` of the points.
    alike : (P,) bool array
        Whether the normals of point and line agree.
    rotated_points, places : (P,) complex arrays [m]
        Rotated points; rotated and translated points.
    """

    def __cinit__(self, OrientedPoints points, double x, double y):
        self.points, self.x, self.y, self.table = points, x, y, np.zeros((FIT_ROWS, points.size))

    @property
    def residuals(self):
        return np.asarray(self.table[:ROWS])

    @property
    def alike(self):
        return np.asarray(self.table[ALIKE]) == 1.0

    @property
    def rotated_points(self):
        return np.asarray(self.table[ROTATED_X]) + 1j * np.asarray(self.table[ROTATED_Y])

    @property
    def places(self):
        return self.rotated_points + complex(self.x, self.y)

    cpdef Fit of_every(self, Py_ssize_t step, OrientedPoints points):
        """Return the fit of every `step`-th point, which `points` are."""
        cdef Fit found = Fit(points, self.x, self.y)
        found.table[:, :] = self.table[:, ::step]
        return found

    @cython.boundscheck(False)
    cdef void weigh(self, double scale) noexcept nogil:
        """Write the weights by a kernel (Eq. 18) of the `scale` [m], 0 where the normals disagree."""
        cdef const double[::1] weights = self.points.weights_view
        cdef double factor = kernel_factor(scale)
        cdef double *error = &self.table[ERROR, 0]
        cdef double *alike = &self.table[ALIKE, 0]
        cdef double *near = &self.table[KERNEL, 0]
        cdef Py_ssize_t k
        for k in range(self.points.size):
            near[k] = kernel(error[k], factor) * alike[k]
        for k in range(self.points.size):
            self.table[WEIGHT, k] = near[k] * weights[k]

    @cython.boundscheck(False)
    cdef void derive_by_own(self, double theta) noexcept nogil:
        """Write the derivatives of the errors by the points' own normals, for a heading `theta` [rad] of the scan."""
        cdef const double complex[::1] normals = self.points.normals_view
        cdef const double[::1] inverse_noise = self.points.inverse_noise_view
        cdef double[:, ::1] table = self.table
        cdef double c = cos(theta), s = sin(theta), nx, ny, x, y
        cdef Py_ssize_t k
        for k in range(self.points.size):
            nx, ny = normals[k].real * inverse_noise[k], normals[k].imag * inverse_noise[k]
            x, y = c * nx - s * ny, s * nx + c * ny
            table[OWN_X, k], table[OWN_Y, k] = x, y
            table[OWN_THETA, k] = table[ROTATED_X, k] * y - table[ROTATED_Y, k] * x


    @cython.boundscheck(False)
    cdef Agreement agreement(self, double angle, double scale) noexcept nogil:
        """Return how well both normals of all points near a line agree along a direction [rad].

        Points are near by a kernel of the `scale` [m], whether their normals are alike or not. The ratio of the sums is
        1 for equal normals, and 0 on average for normals that are independent.
        """
        cdef const double[::1] weights = self.points.weights_view
        cdef double[:, ::1] table = self.table
        cdef double c = cos(angle), s = sin(angle), factor = kernel_factor(scale), line, own, weight
        cdef Agreement found = Agreement(0.0, 0.0)
        cdef Py_ssize_t k
        for k in range(self.points.size):
            line, own = c * table[BY_X, k] + s * table[BY_Y, k], c * table[OWN_X, k] + s * table[OWN_Y, k]
            if table[BY_X, k] != 0.0 or table[BY_Y, k] != 0.0:
                weight = weights[k] * kernel(table[ERROR, k], factor)
                found.shared += weight * line * own
                found.seen += 0.5 * weight * (line * line + own * own)
        return found


def fit(candidate, OrientedPoints points, field):
    """Find the `Fit` of a scan's points to the reference.

    Parameters
    ----------
    candidate : (3,) array [m, m, rad]
    points : OrientedPoints
        Of the current scan.
    field : LikelihoodField
        Of the reference.
    """
    cdef Hypothesis at
    at.x, at.y, at.theta = candidate
    return fit_at(&at, points, lines_of(field))


@cython.boundscheck(False)
cdef Fit fit_at(Hypothesis *at, OrientedPoints points, Lines lines):
    """Return the `Fit` at a hypothesis."""
    cdef Pose pose = pose_at(at.x, at.y, at.theta)
    cdef Fit found = Fit(points, at.x, at.y)
    cdef double[:, ::1] table = found.table
    cdef Matches match
    cdef Py_ssize_t first = 0, i, k
    with nogil:
        while first < points.size:
            match_points(points, lines, first, &pose, &match)
            for i in range(match.size):
                k = first + i
                table[ERROR, k], table[ALIKE, k] = match.error[i], match.alike[i]
                # Jacobian (nx, -ny, -Im(n p)) of the conjugated normal n and the rotated point p.
                table[BY_X, k], table[BY_Y, k] = match.nx[i], -match.ny[i]
                table[BY_THETA, k] = -(match.nx[i] * match.y[i] + match.ny[i] * match.x[i])
                table[ROTATED_X, k], table[ROTATED_Y, k] = match.x[i], match.y[i]
            first += BLOCK
    return found


def polish(candidate, Fit found, refinement):
    """Refine a candidate ``(3,)`` [m, m, rad] with a kernel (Eq. 18) that narrows to the spread of the errors.

    The correspondences of `found`, the candidate's `Fit`, are kept, so the errors are linear in the step. A candidate
    that moves farther than the first kernel, as it may along a corridor, is returned unchanged.

    Returns
    -------
    candidate : (3,) array [m, m, rad]
    found : Fit
        Of it.
    """
    cdef Fit moved = found.of_every(1, found.points)
    cdef double[:, ::1] table = moved.table
    cdef double scale = FINAL_SCALE, damping = refinement.damping, count
    cdef Equations sums
    cdef double[3] step
    cdef double[3] total = [0.0, 0.0, 0.0]
    cdef Py_ssize_t k
    for _ in range(refinement.polish_iterations):
        moved.weigh(scale)
        sums, count = NO_POINTS, 0.0
        for k in range(table.shape[1]):
            count += table[WEIGHT, k]
            add_row(&sums, table[WEIGHT, k], table[BY_X, k], table[BY_Y, k], table[BY_THETA, k], table[ERROR, k])
        solve_step(&sums, damping, step)
        scale = refinement.narrowed(scale, sqrt(sums.e / max(count, TINY)))
        for k in range(3):
            total[k] += step[k]
        for k in range(table.shape[1]):
            table[ERROR, k] -= step[0] * table[BY_X, k] + step[1] * table[BY_Y, k] + step[2] * table[BY_THETA, k]
    if length_of(total[0], total[1]) >= FINAL_SCALE:
        return candidate, found
    return candidate - np.array((total[0], total[1], total[2])), moved
