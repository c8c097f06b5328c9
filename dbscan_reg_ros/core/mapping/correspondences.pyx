# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Point-to-line correspondences of a scan with all key frames, and robust alignment by them."""
import numpy as np

from ..geometry import tolerance
from ..geometry.se2 import SE2

from libc.stdlib cimport free, malloc
from libc.string cimport memset

from ..geometry.exponential cimport decaying_exp
from ..geometry.plane cimport wrap
from ..registration.point_to_line cimport Equations, add_row, solve_step

cdef double TINY = tolerance.TINY


cdef class Correspondences:
    """M pairs of a point of a scan and the line of a key frame on which the point lies.

    Attributes
    ----------
    pose : SE2
        Pose of the scan at which the pairs were looked up, in the odometry frame.
    size : int
        Number of points of the scan.
    """

    def __cinit__(self, pose, Py_ssize_t size, Py_ssize_t most):
        self.pose, self.size, self.scale = pose, size, 0.0
        self.pairs = <Pair *> malloc(max(most, 1) * sizeof(Pair))
        self.total = <double *> malloc(max(size, 1) * sizeof(double))
        if self.pairs == NULL or self.total == NULL:
            raise MemoryError

    def __dealloc__(self):
        free(self.pairs)
        free(self.total)

    def __len__(self):
        return self.count

    @property
    def frame(self):
        """``(M,)`` int: index of the key frame of each pair."""
        return self.table()['frame']

    @property
    def index(self):
        """``(M,)`` int: index of the point of each pair."""
        return self.table()['point']

    @property
    def rows(self):
        """``(4, M)`` float: `residuals.linear_residuals` [m] of the pairs at `pose`, for rotations about the sensor."""
        table = self.table()
        return np.array((table['a'], table['b'], table['r'], table['e']))

    @property
    def weights(self):
        """``(M,)`` float: given weight of each pair, from 0 to 1."""
        return self.table()['given']

    def table(self):
        """Return a copy of the pairs ``(M,)``, with the fields of `Pair`."""
        return np.array(<Pair[:max(self.count, 1)]> self.pairs)[:self.count]

    def match(self, other, double scale):
        """Return errors [m] and weights ``(M,)`` at another pose, by a kernel of the `scale` [m]."""
        cdef double[:, ::1] values = np.empty((2, self.count))
        pose = self.pose
        cdef double[3] step = [other.x - pose.x, other.y - pose.y, wrap(other.theta - pose.theta)]
        cdef Py_ssize_t k
        self.weigh(step, scale)
        for k in range(self.count):
            values[0, k] = (step[0] * self.pairs[k].a + step[1] * self.pairs[k].b + step[2] * self.pairs[k].r
                            + self.pairs[k].e)
            values[1, k] = self.pairs[k].weight
        return np.asarray(values[0]), np.asarray(values[1])

    cdef void weigh(self, const double *step, double scale) noexcept nogil:
        """Weight the pairs after a step (x, y, theta) by a kernel (Eq. 18) of the `scale` [m] and their given weights.

        The weights of all pairs of one point sum to at most 1.
        """
        cdef double factor = -0.5 / (scale * scale), e
        cdef Pair *pair
        cdef Py_ssize_t k
        if scale == self.scale and step[0] == self.step[0] and step[1] == self.step[1] and step[2] == self.step[2]:
            return
        self.scale, self.step = scale, [step[0], step[1], step[2]]
        memset(self.total, 0, self.size * sizeof(double))
        for k in range(self.count):
            pair = &self.pairs[k]
            e = step[0] * pair.a + step[1] * pair.b + step[2] * pair.r + pair.e
            pair.weight = decaying_exp(factor * e * e)
            self.total[pair.point] += pair.weight
        for k in range(self.count):
            pair = &self.pairs[k]
            pair.weight = pair.weight / max(self.total[pair.point], 1.0) * pair.given

    cdef void add(self, const double *step, double scale, Equations *sums) noexcept nogil:
        """Weight the pairs as `weigh`, and add them to normal equations."""
        cdef Pair *pair
        cdef Py_ssize_t k
        self.weigh(step, scale)
        for k in range(self.count):
            pair = &self.pairs[k]
            add_row(sums, pair.weight, pair.a, pair.b, pair.r, pair.e)


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
    cdef double factor = -0.5 / (scale * scale), e, w, apart
    cdef double dx = found.pose.x - own.pose.x, dy = found.pose.y - own.pose.y
    cdef double turn = wrap(found.pose.theta - own.pose.theta)
    # Of the pairs of each point with other and with own key frames: sum of the weights, and of the weighted errors.
    cdef double[:, ::1] sums = np.zeros((4, found.size))
    cdef double[::1] agreement = np.empty(found.size)
    cdef Py_ssize_t k, p
    cdef Pair *pair
    with nogil:
        for k in range(found.count):
            pair = &found.pairs[k]
            if not is_own[pair.frame]:
                p, w = pair.point, decaying_exp(factor * pair.e * pair.e)
                sums[0, p] += w
                sums[1, p] += w * pair.e
        for k in range(own.count):
            pair = &own.pairs[k]
            e = dx * pair.a + dy * pair.b + turn * pair.r + pair.e
            p, w = pair.point, decaying_exp(factor * e * e)
            sums[2, p] += w
            sums[3, p] += w * e
        for p in range(found.size):
            sums[0, p], sums[2, p] = max(sums[0, p], TINY), max(sums[2, p], TINY)
            apart = (sums[1, p] / sums[0, p] - sums[3, p] / sums[2, p]) / noise
            agreement[p] = decaying_exp(-0.5 * apart * apart / (1.0 / sums[0, p] + 1.0 / sums[2, p]))
        for k in range(found.count):
            pair = &found.pairs[k]
            if not is_own[pair.frame]:
                pair.given *= agreement[pair.point]
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
