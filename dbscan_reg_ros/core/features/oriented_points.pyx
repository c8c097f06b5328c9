# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Points of a scan with unit normals, and the points that constrain a direction which few others do."""
import numpy as np

from ..geometry import tolerance

from ..geometry.plane cimport modulus, rotated, vector
from .point_weights cimport leverage_weight

cdef double TINY = tolerance.TINY
# Ridge of the leverage, in units of the mean square of a normal: a rare direction weighs at most twice as much.
cdef double LEVERAGE_RIDGE = 1.0


cdef class OrientedPoints:
    """Points with normals that are compared with a reference.

    Positions and directions in the plane are complex numbers, here and wherever scans are compared, because a rotation
    is then a product.

    Attributes
    ----------
    points : (P,) complex [m]
    normals : (P,) complex
        Unit normals that face the sensor.
    beams : (P,) int
        Beam of each point.
    weights : (P,) float or None
        Weight of each point, from 0 to 1; None where all are 1.
    inverse_noise : (P,) float or None
        Inverse noise scale of each point, from 0 to 1, by which errors are multiplied; None where all are 1.
    """

    def __init__(self, points, normals, beams, weights=None, inverse_noise=None):
        self.points, self.normals, self.beams = points, normals, beams
        self.weights, self.inverse_noise = weights, inverse_noise
        self.points_view, self.normals_view, self.beams_view = points, normals, beams
        self.size = self.points_view.shape[0]
        self.weights_view = given_or_ones(weights, self.size)
        self.inverse_noise_view = given_or_ones(inverse_noise, self.size)
        if not (self.size == self.normals_view.shape[0] == self.beams_view.shape[0] == self.weights_view.shape[0]
                == self.inverse_noise_view.shape[0]):
            raise ValueError('arrays of different lengths')

    def __len__(self):
        return self.size

    def __reduce__(self):
        return OrientedPoints, (self.points, self.normals, self.beams, self.weights, self.inverse_noise)

    def select(self, chosen):
        """Return the points that `chosen` selects: indices, a mask ``(P,)`` or a slice."""
        weights, inverse_noise = [part if part is None else part[chosen] for part in (self.weights, self.inverse_noise)]
        return OrientedPoints(self.points[chosen], self.normals[chosen], self.beams[chosen], weights, inverse_noise)

    cdef OrientedPoints first(self, Py_ssize_t count):
        """Return the first points, without weights and noise scales."""
        return OrientedPoints(self.points[:count], self.normals[:count], self.beams[:count])

    def joined(self, OrientedPoints other):
        """Append the `other` points; the inverse noise scale of all points becomes 1."""
        return OrientedPoints(
            np.concatenate((self.points, other.points)), np.concatenate((self.normals, other.normals)),
            np.concatenate((self.beams, other.beams)), np.concatenate((self.weights_view, other.weights_view)))

    def thinned(self, Py_ssize_t count):
        """Return at most `count` of the points, evenly spaced along the scan."""
        step = spacing(self.size, count)
        if step <= 1:
            return self
        # Contiguous copies: with numpy 1.26 the last bit of a product over strided arrays depends on their address.
        parts = self.points, self.normals, self.beams, self.weights, self.inverse_noise
        return OrientedPoints(*[None if part is None else part[::step].copy() for part in parts])


cdef OrientedPoints oriented_with_poles(const double[:, ::1] place, const double[:, ::1] facing,
                                        const Py_ssize_t[::1] of, OrientedPoints poles, weights, double noise_scale):
    """Collect the points that have a normal, and the poles.

    Parameters
    ----------
    place, facing : (P, 2) float
        Points [m] and their normals; 0 for points without one.
    of : (P,) int
        Beam of each point.
    poles : OrientedPoints or None
    weights : (Q,) float or None
        Weight of each point that is collected; None: poles have their own, all others 1.
    noise_scale : float
        Noise scale of a point per range [1/m]; points with a scale below 1 have 1.
    """
    cdef Py_ssize_t size = of.shape[0] + (0 if poles is None else poles.size), walls = 0, count, k
    vectors, beams = np.empty((2, size), complex), np.empty(size, np.intp)
    cdef double complex[:, ::1] each = vectors
    cdef Py_ssize_t[::1] beam = beams
    cdef double[::1] inverse_noise
    cdef bint noisy = False
    if not (place.shape[0] == facing.shape[0] == of.shape[0] and place.shape[1] == facing.shape[1] == 2):
        raise ValueError('arrays of different lengths')
    for k in range(of.shape[0]):
        if facing[k, 0] != 0.0 or facing[k, 1] != 0.0:
            each[0, walls], each[1, walls] = vector(place[k, 0], place[k, 1]), vector(facing[k, 0], facing[k, 1])
            beam[walls] = of[k]
            walls += 1
    count = walls
    if poles is not None:
        count += poles.size
        for k in range(poles.size):
            each[0, walls + k], each[1, walls + k] = poles.points_view[k], poles.normals_view[k]
            beam[walls + k] = poles.beams_view[k]
        if weights is None:
            weights = np.ones(count)
            weights[walls:] = poles.weights_view
    scales = None
    if noise_scale > 0.0:
        scales = np.empty(count)
        inverse_noise = scales
        for k in range(count):
            inverse_noise[k] = 1.0 / max(noise_scale * modulus(each[0, k]), 1.0)
            noisy |= inverse_noise[k] < 1.0
    return OrientedPoints(vectors[0, :count], vectors[1, :count], beams[:count], weights, scales if noisy else None)


def spacing(Py_ssize_t size, Py_ssize_t count):
    """Return the index step with which at most `count` of `size` points are selected."""
    return (size + count - 1) // count


def leverage(OrientedPoints oriented):
    """Return weights ``(P,)`` with sum 1 that are larger for points with a rare normal direction.

    In a corridor this raises the weight of the few points whose normals point along it. The weight is the statistical
    leverage of the normal in a ridge regression.
    """
    cdef const double complex[::1] normals = oriented.normals_view
    cdef const double[::1] given = oriented.weights_view
    cdef Py_ssize_t size = oriented.size, k
    cdef double xx = 0.0, xy = 0.0, yy = 0.0, x, y, total = 0.0
    weights = np.empty(size)
    cdef double[::1] weight = weights
    with nogil:
        for k in range(size):
            x, y = normals[k].real, normals[k].imag
            xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
        xx, xy, yy = xx / max(size, 1) + LEVERAGE_RIDGE, xy / max(size, 1), yy / max(size, 1) + LEVERAGE_RIDGE
        for k in range(size):
            x, y = normals[k].real, normals[k].imag
            weight[k] = leverage_weight(x, y, xx, xy, yy) * given[k]
            total += weight[k]
        for k in range(size):
            weight[k] /= max(total, TINY)
    return weights


cpdef high_leverage(const double complex[::1] normals):
    """Find points with a rare normal direction: those with more than twice the mean leverage.

    The factor of two is the rule of thumb of Hoaglin and Welsch, "The hat matrix in regression and ANOVA", The American
    Statistician 32, 1978.

    Parameters
    ----------
    normals : (P,) complex
        Unit normals.

    Returns
    -------
    (P,) bool
    """
    cdef Py_ssize_t size = normals.shape[0], k
    cdef double x = 0.0, y = 0.0
    cdef double complex double_angle
    flags = np.empty(size, dtype=bool)
    cdef unsigned char[::1] rare = flags
    with nogil:
        # The double angle makes a direction and its opposite equal: the leverage is 2 (1 - c r) / (1 - r^2).
        for k in range(size):
            double_angle = rotated(normals[k], normals[k])
            x, y = x + double_angle.real, y + double_angle.imag
        x, y = x / max(size, 1), y / max(size, 1)
        for k in range(size):
            double_angle = rotated(normals[k], normals[k])
            rare[k] = double_angle.real * x + double_angle.imag * y < 2.0 * (x * x + y * y) - 1.0
    return flags


def sample(OrientedPoints oriented, Py_ssize_t count):
    """Return at most `count` points, evenly spaced along the scan, and in addition all points of `high_leverage`."""
    if oriented.size <= count:
        return oriented
    chosen = high_leverage(oriented.normals_view)
    chosen[::spacing(oriented.size, count)] = True
    return oriented.select(chosen.nonzero()[0])


cdef const double[::1] ones = np.ones(4096)


cdef const double[::1] given_or_ones(values, Py_ssize_t size):
    """Return the values of P points; where they are None as many ones."""
    if values is not None:
        return values
    return ones[:size] if size <= ones.shape[0] else np.ones(size)
