# SPDX-License-Identifier: Apache-2.0
"""Oriented points of a scan: points with unit normals, their weights and their thinning."""
from dataclasses import dataclass

import numpy as np

from ..geometry.se2 import as_complex


@dataclass(frozen=True, eq=False)
class OrientedPoints:
    """The points of a scan that are compared to a reference.

    Places and directions of the plane are complex numbers here and in all that compares scans: turning is multiplying.

    Attributes
    ----------
    points : (P,) complex [m]
    normals : (P,) complex
        Unit normals that face the sensor.
    beams : (P,) int
        The beam of each.
    worth : (P,) float or None
        What each counts, from 0 to 1; None: all the same.
    sharpness : (P,) float or None
        What distances of each from a line are multiplied by, from 0 to 1, as it is noisier than others; None: 1.
    """

    points: np.ndarray
    normals: np.ndarray
    beams: np.ndarray
    weights: np.ndarray | None = None
    inverse_noise: np.ndarray | None = None

    def __len__(self):
        return len(self.points)

    def select(self, chosen):
        """The points that `chosen`, a mask or indices, picks."""
        weights, inverse_noise = (part if part is None else part[chosen] for part in (self.weights, self.inverse_noise))
        return OrientedPoints(self.points[chosen], self.normals[chosen], self.beams[chosen], weights, inverse_noise)

    def joined(self, other):
        """These points and then those of another cloud, all of them sharp."""
        parts = (self.points, other.points), (self.normals, other.normals), (self.beams, other.beams)
        weights = np.concatenate([each.weighted(np.ones(len(each))) for each in (self, other)])
        return OrientedPoints(*map(np.concatenate, parts), weights)

    def weighted(self, weight):
        """A `weight` ``(..., P)`` of the points times what they count."""
        return weight if self.weights is None else weight * self.weights

    def sharpened(self, values):
        """`values` ``(..., P)`` in units of each point's noise, where that is unusual."""
        return values if self.inverse_noise is None else values * self.inverse_noise

    def tolerance(self, distance):
        """A `distance` [m] that is more for points noisier than others."""
        return distance if self.inverse_noise is None else distance / self.inverse_noise

    def thinned(self, count):
        """At most `count` of the points, evenly along the scan."""
        step = stride(len(self), count)
        # A copy: with arrays that skip, the last bit of a product depends in numpy 1.26 on where in memory they lie.
        return self if step <= 1 else self.select(np.arange(0, len(self), step))


def stride(size, count):
    """The step from one point to the next where at most `count` of `size` are kept."""
    return -(-size // count)


def build_oriented_points(points, normals, beams) -> OrientedPoints:
    """The `OrientedPoints` of a scan from its points and normals ``(P, 2)``, those without a normal left out."""
    normals = as_complex(normals)
    known = normals != 0.0
    return OrientedPoints(as_complex(points)[known], normals[known], beams[known])


def leverage(cloud: OrientedPoints, balance):
    """Weight ``(P,)`` of each point, in sum 1: more where few points face the same way.

    In a corridor the few points that face along it decide, not the hundreds on its walls. The weight is the statistical
    leverage of the point's normal, with `balance` as ridge: large values make all points equal.
    """
    size = max(len(cloud), 1)
    nx, ny = cloud.normals.real, cloud.normals.imag
    xx, xy, yy = nx @ nx / size + balance, nx @ ny / size, ny @ ny / size + balance
    weight = cloud.weighted(yy * nx * nx - 2.0 * xy * nx * ny + xx * ny * ny)
    return weight / max(float(weight.sum()), 1e-9)


def high_leverage(normals):
    """``(P,)`` bool: points that face where few others do, those with more than twice the mean leverage.

    The rule of thumb of Hoaglin and Welsch, "The hat matrix in regression and ANOVA", The American Statistician 32, 1978.

    Parameters
    ----------
    normals : (P,) complex array
        Unit normals.
    """
    # With the double angle a direction and its opposite are one, and the leverage is 2 (1 - c r) / (1 - r^2), in the mean 2:
    # r is the length of the mean direction, and c r the part of a direction along it.
    double = normals * normals
    mean = complex(double.sum()) / max(len(double), 1)
    return (double * mean.conjugate()).real < 2.0 * abs(mean) ** 2 - 1.0


def sample(cloud: OrientedPoints, count):
    """At most `count` of the points, evenly along the scan, and all of `high_leverage`: in a corridor those decide."""
    if len(cloud) <= count:
        return cloud
    chosen = high_leverage(cloud.normals)
    chosen[::stride(len(cloud), count)] = True
    return cloud.select(chosen.nonzero()[0])
