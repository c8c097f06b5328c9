# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Point-to-line correspondences of a scan with all key frames, and robust alignment by them."""
import numpy as np

from ..geometry import tolerance
from ..geometry.se2 import SE2

from libc.stdlib cimport free, malloc
from libc.string cimport memset

from ..features.point_weights cimport kernel, kernel_factor
from ..geometry.exponential cimport decaying_exp
from ..geometry.plane cimport wrap
from ..registration.point_to_line cimport Equations, add_row, solve_step

cdef double TINY = tolerance.TINY

ctypedef fused Number:
    int
    double


cdef class Correspondences:
    """M pairs of a point of a scan and the line of a key frame on which the point lies.

    Attributes
    ----------
    pose : SE2
        Pose of the scan at which the pairs were looked up, in the odometry frame.
    size : int
        Number of points of the scan.
    """

    def __cinit__(self, Py_ssize_t size, Py_ssize_t most):
        # Whole lanes, and one pair that is written but not counted.
        most += LANES - most % LANES
        self.size, self.most = size, most
        self.block = <double *> malloc((7 * most + size) * sizeof(double))
        self.turned = <Turned *> malloc(max(size, 1) * sizeof(Turned))
        if self.block == NULL or self.turned == NULL:
            raise MemoryError
        self.a, self.b, self.r, self.e = self.block, self.block + most, self.block + 2 * most, self.block + 3 * most
        self.given, self.weight, self.total = self.block + 4 * most, self.block + 5 * most, self.block + 7 * most
        self.of_frame = <int *> (self.block + 6 * most)
        self.of_point = self.of_frame + most

    def __dealloc__(self):
        free(self.block)
        free(self.turned)

    def __len__(self):
        return self.count

    @property
    def frame(self):
        """``(M,)`` int: index of the key frame of each pair."""
        return copied(self.of_frame, self.count)

    @property
    def index(self):
        """``(M,)`` int: index of the point of each pair."""
        return copied(self.of_point, self.count)

    @property
    def rows(self):
        """``(4, M)`` float: `residuals.linear_residuals` [m] of the pairs at `pose`, for rotations about the sensor."""
        return np.array(<double[:4, :self.most]> self.block)[:, :self.count]

    @property
    def weights(self):
        """``(M,)`` float: given weight of each pair, from 0 to 1."""
        return copied(self.given, self.count)

    def match(self, other, double scale):
        """Return errors [m] and weights ``(M,)`` at another pose, by a kernel of the `scale` [m]."""
        pose = self.pose
        cdef double[3] step = [other.x - pose.x, other.y - pose.y, wrap(other.theta - pose.theta)]
        self.weigh(step, scale)
        return np.array((step[0], step[1], step[2], 1.0)) @ self.rows, copied(self.weight, self.count)

    cdef void end(self) noexcept nogil:
        """Fill the last lanes after the last pair."""
        cdef Py_ssize_t k
        for k in range(self.count, self.count + LANES - self.count % LANES):
            self.a[k] = self.b[k] = self.r[k] = self.e[k] = 0.0
        self.scale = 0.0

    cdef void weigh(self, const double *step, double scale) noexcept nogil:
        """Weight the pairs after a step (x, y, theta) by a kernel (Eq. 18) of the `scale` [m] and their given weights.

        The weights of all pairs of one point sum to at most 1.
        """
        cdef double factor = kernel_factor(scale), x = step[0], y = step[1], theta = step[2]
        cdef double *a = self.a
        cdef double *b = self.b
        cdef double *r = self.r
        cdef double *e = self.e
        cdef double *weight = self.weight
        cdef double *total = self.total
        cdef double[LANES] error
        cdef Py_ssize_t block, first, k
        if scale == self.scale and x == self.step[0] and y == self.step[1] and theta == self.step[2]:
            return
        self.scale, self.step = scale, [x, y, theta]
        for block in range((self.count + LANES - 1) // LANES):
            first = LANES * block
            for k in range(LANES):
                error[k] = x * a[first + k] + y * b[first + k] + theta * r[first + k] + e[first + k]
            for k in range(LANES):
                weight[first + k] = kernel(error[k], factor)
        memset(total, 0, self.size * sizeof(double))
        for k in range(self.count):
            total[self.of_point[k]] += weight[k]
        for k in range(self.count):
            weight[k] = weight[k] / max(total[self.of_point[k]], 1.0) * self.given[k]

    cdef void add(self, const double *step, double scale, Equations *sums) noexcept nogil:
        """Weight the pairs as `weigh`, and add them to normal equations."""
        cdef Equations total = sums[0]
        cdef Py_ssize_t k
        self.weigh(step, scale)
        for k in range(self.count):
            add_row(&total, self.weight[k], self.a[k], self.b[k], self.r[k], self.e[k])
        sums[0] = total


cdef copied(Number *values, Py_ssize_t count):
    """Return a copy of as many values."""
    return np.array(<Number[:max(count, 1)]> values)[:count]


def weighted_by_agreement(Correspondences found, Correspondences own, const unsigned char[::1] is_own, double scale,
                          double noise):
    """Weight the pairs with key frames of other lidars by their agreement with the key frames of the own lidar.

    Parameters
    ----------
    found : Correspondences
        Of the scan with the key frames of all lidars; their given weights are multiplied.
    own : Correspondences
        Of the scan with those of its own lidar, at a pose nearby.
    is_own : (K,) bool
        Which key frames are those of the own lidar.
    scale : float [m]
        Of the kernel (Eq. 18) in the mean errors.
    noise : float [m]
        Standard deviation of an error.
    """
    cdef double factor = kernel_factor(scale), e, w, apart
    cdef double dx = found.pose.x - own.pose.x, dy = found.pose.y - own.pose.y
    cdef double turn = wrap(found.pose.theta - own.pose.theta)
    # Of the pairs of each point with other and with own key frames: sum of the weights, and of the weighted errors.
    cdef double[:, ::1] sums = np.zeros((4, found.size))
    cdef double[::1] agreement = np.empty(found.size)
    cdef Py_ssize_t k, p
    with nogil:
        for k in range(found.count):
            if not is_own[found.of_frame[k]]:
                p, w = found.of_point[k], kernel(found.e[k], factor)
                sums[0, p] += w
                sums[1, p] += w * found.e[k]
        for k in range(own.count):
            e = dx * own.a[k] + dy * own.b[k] + turn * own.r[k] + own.e[k]
            p, w = own.of_point[k], kernel(e, factor)
            sums[2, p] += w
            sums[3, p] += w * e
        for p in range(found.size):
            sums[0, p], sums[2, p] = max(sums[0, p], TINY), max(sums[2, p], TINY)
            apart = (sums[1, p] / sums[0, p] - sums[3, p] / sums[2, p]) / noise
            agreement[p] = decaying_exp(-0.5 * apart * apart / (1.0 / sums[0, p] + 1.0 / sums[2, p]))
        for k in range(found.count):
            if not is_own[found.of_frame[k]]:
                found.given[k] *= agreement[found.of_point[k]]
    found.scale = 0.0


def align(Correspondences found, start, prior, scales, double damping):
    """Align a scan with all key frames by robust point-to-line iterations, one for each of the `scales` [m].

    Parameters
    ----------
    found : Correspondences
        Of the scan at a pose nearby.
    start : SE2
        Initial pose in the odometry frame.
    prior : PosePrior
        Information in the odometry frame, in units of one point's.
    scales : sequence of float [m]
        Scales of the kernel.
    damping : float
        As for `solve_step`.
    """
    pose = found.pose
    cdef const double[:, ::1] known = prior.information
    cdef double[3] step = [start.x - pose.x, start.y - pose.y, wrap(start.theta - pose.theta)]
    cdef double x = pose.x - prior.pose.x, y = pose.y - prior.pose.y, t = wrap(pose.theta - prior.pose.theta)
    cdef Equations sums
    for scale in scales:
        sums = Equations(known[0, 0], known[0, 1], known[0, 2], known[0, 0] * x + known[0, 1] * y + known[0, 2] * t,
                         known[1, 1], known[1, 2], known[1, 0] * x + known[1, 1] * y + known[1, 2] * t,
                         known[2, 2], known[2, 0] * x + known[2, 1] * y + known[2, 2] * t, 0.0)
        found.add(step, scale, &sums)
        solve_step(&sums, damping, step)
        step[0], step[1], step[2] = -step[0], -step[1], -step[2]
    return SE2(pose.x + step[0], pose.y + step[1], wrap(pose.theta + step[2]))
