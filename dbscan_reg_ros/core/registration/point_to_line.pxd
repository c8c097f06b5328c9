# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Point-to-line correspondences and their normal equations (Eq. 16-18)."""
from libc.math cimport cos, sin

from ..features.oriented_points cimport BLOCK, OrientedPoints
from ..geometry.symmetric cimport Factors, factors

from .views cimport Lines


cdef struct Pose:
    # Position [m], cosine and sine of the heading.
    double x, y, c, s


cdef inline Pose pose_at(double x, double y, double theta) noexcept nogil:
    """Return the pose at a position [m] with a heading [rad]."""
    return Pose(x, y, cos(theta), sin(theta))


cdef struct Matches:
    # Of each point of a block: the rotated point [m]; normal of the line and distance from it [m], both times the
    # inverse noise scale; 1 where the normals agree, else 0; weight by a kernel; cell.
    Py_ssize_t size
    double[BLOCK] x
    double[BLOCK] y
    double[BLOCK] nx
    double[BLOCK] ny
    double[BLOCK] error
    double[BLOCK] alike
    double[BLOCK] weight
    int[BLOCK] row
    int[BLOCK] column


cdef struct Equations:
    # Upper triangle of the weighted squares of the rows (x, y, theta, error).
    double xx, xy, xt, x, yy, yt, y, tt, t, e


cdef inline void add_row(Equations *sums, double weight, double a, double b, double r, double e) noexcept nogil:
    """Add a point with the Jacobian (a, b, r) and the error e to the normal equations."""
    sums.xx += weight * a * a
    sums.xy += weight * a * b
    sums.xt += weight * a * r
    sums.x += weight * a * e
    sums.yy += weight * b * b
    sums.yt += weight * b * r
    sums.y += weight * b * e
    sums.tt += weight * r * r
    sums.t += weight * r * e
    sums.e += weight * e * e


cdef inline void solve_step(Equations *s, double damping, double *step) noexcept nogil:
    """Solve the normal equations for a damped step (x, y, theta) [m, m, rad], by L D L'."""
    cdef double added = damping * (s.xx + s.yy + 1e-6)
    cdef Factors f = factors(s.xx + added, s.xy, s.xt, s.yy + added, s.yt, s.tt + added)
    cdef double y = s.y - f.p * s.x, t = (s.t - f.q * s.x - f.r * y) / f.c
    y = y / f.b - f.r * t
    step[0], step[1], step[2] = s.x / f.a - f.p * y - f.q * t, y, t


cdef inline void write_equations(Equations *s, double *table) noexcept nogil:
    """Write the normal equations as the rows of a symmetric matrix (4, 4)."""
    table[0], table[1], table[2], table[3] = s.xx, s.xy, s.xt, s.x
    table[4], table[5], table[6], table[7] = s.xy, s.yy, s.yt, s.y
    table[8], table[9], table[10], table[11] = s.xt, s.yt, s.tt, s.t
    table[12], table[13], table[14], table[15] = s.x, s.y, s.t, s.e


cdef struct Hypothesis:
    # Motion [m, m, rad]; score, overlap and conflict, as `write_scores` has them; log-odds, by `assess`; equations of
    # the last iteration.
    double x, y, theta, score, overlap, conflict, odds
    Equations equations


cdef class Hypotheses:
    # As many `rows` as `size` says, and place for `most`; `spare` is as long, and so is each row of `number` and `index`,
    # in which a function keeps what it sorts and chooses by: keys, indices, flags. Nothing is left there for another.
    cdef Hypothesis *block
    cdef Hypothesis *rows
    cdef Hypothesis *spare
    cdef Py_ssize_t size, most
    cdef double[:, ::1] number
    cdef Py_ssize_t[:, ::1] index
    cdef int reserve(self, Py_ssize_t most) except -1
    cdef int add(self, const double[:, :] motions) except -1
    cdef int select(self, const Py_ssize_t[::1] chosen, Py_ssize_t count) except -1 nogil
    cdef motions(self)


cdef int refine_hypotheses(OrientedPoints points, Lines field, double damping, const double[::1] scales,
                           Hypotheses found) except -1 nogil
cdef void match_points(OrientedPoints points, Lines lines, Py_ssize_t first, Pose *pose,
                       Matches *found) noexcept nogil
cdef void weigh(Matches *found, double scale) noexcept nogil
cdef int add_points(OrientedPoints points, Lines field, Pose *pose, double scale, Equations *sums) except -1 nogil
