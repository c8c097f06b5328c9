# SPDX-License-Identifier: Apache-2.0
"""Oriented points of a scan: points with unit normals, their weights, and how they are sampled."""
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.se2 import as_complex
from ..geometry.tolerance import TINY

Values = TypeVar('Values', FloatArray, ComplexArray)


@dataclass(frozen=True, eq=False)
class OrientedPoints:
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

    points: ComplexArray
    normals: ComplexArray
    beams: IntArray
    weights: FloatArray | None = None
    inverse_noise: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.points)

    def select(self, chosen: IntArray | BoolArray | slice) -> 'OrientedPoints':
        """Return the points that `chosen` selects; it holds indices, a mask or a slice."""
        weights, inverse_noise = (part if part is None else part[chosen] for part in (self.weights, self.inverse_noise))
        return OrientedPoints(self.points[chosen], self.normals[chosen], self.beams[chosen], weights, inverse_noise)

    def joined(self, other: 'OrientedPoints') -> 'OrientedPoints':
        """Append the `other` points; the inverse noise scale of all points becomes 1."""
        return OrientedPoints(
            np.concatenate((self.points, other.points)), np.concatenate((self.normals, other.normals)),
            np.concatenate((self.beams, other.beams)),
            np.concatenate([each.weighted(np.ones(len(each))) for each in (self, other)]))

    def weighted(self, weight: FloatArray) -> FloatArray:
        """Multiply a `weight` ``(..., P)`` by the weights of the points."""
        return weight if self.weights is None else weight * self.weights

    def sharpened(self, values: Values) -> Values:
        """Multiply real or complex `values` ``(..., P)`` by the inverse noise scale of the points."""
        return values if self.inverse_noise is None else values * self.inverse_noise

    def tolerance(self, distance: float) -> float | FloatArray:
        """Divide a `distance` [m] by the inverse noise scale of each point ``(P,)``; one number if all scales are 1."""
        return distance if self.inverse_noise is None else distance / self.inverse_noise

    def thinned(self, count: int) -> 'OrientedPoints':
        """Return at most `count` of the points, evenly spaced along the scan."""
        step = stride(len(self), count)
        # Contiguous copies: with numpy 1.26 the last bit of a product over strided arrays depends on their address.
        return self if step <= 1 else self.select(np.arange(0, len(self), step))


def stride(size: int, count: int) -> int:
    """Return the index step with which at most `count` of `size` points are selected."""
    return -(-size // count)


def build_oriented_points(points: ArrayLike, normals: ArrayLike, beams: IntArray) -> OrientedPoints:
    """Build `OrientedPoints` from points and normals ``(P, 2)``, leaving out points without a normal."""
    directions = as_complex(normals)
    known = directions != 0.0
    return OrientedPoints(as_complex(points)[known], directions[known], beams[known])


def leverage(oriented: OrientedPoints, ridge: float) -> FloatArray:
    """Return weights ``(P,)`` with sum 1 that are larger for points with a rare normal direction.

    In a corridor this raises the weight of the few points whose normals point along it. The weight is the statistical
    leverage of the normal in a regression with this `ridge`; large values make all weights equal.
    """
    size = max(len(oriented), 1)
    nx, ny = oriented.normals.real, oriented.normals.imag
    xx, xy, yy = nx @ nx / size + ridge, nx @ ny / size, ny @ ny / size + ridge
    weight = oriented.weighted(yy * nx * nx - 2.0 * xy * nx * ny + xx * ny * ny)
    return weight / max(float(weight.sum()), TINY)


def high_leverage(normals: ComplexArray) -> BoolArray:
    """Find points with a rare normal direction: points with more than twice the mean leverage.

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
    # The double angle makes a direction and its opposite equal. The leverage is 2 (1 - c r) / (1 - r^2), with the mean
    # 2: r is the length of the mean direction, and c r the component of a direction along it.
    double = normals * normals
    mean = complex(double.sum()) / max(len(double), 1)
    rare: BoolArray = (double * mean.conjugate()).real < 2.0 * abs(mean) ** 2 - 1.0
    return rare


def sample(oriented: OrientedPoints, count: int) -> OrientedPoints:
    """Return at most `count` points, evenly spaced along the scan, and in addition all points of `high_leverage`."""
    if len(oriented) <= count:
        return oriented
    chosen = high_leverage(oriented.normals)
    chosen[::stride(len(oriented), count)] = True
    return oriented.select(chosen.nonzero()[0])
