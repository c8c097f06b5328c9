# SPDX-License-Identifier: Apache-2.0
"""Sets of points of a scan: in beam order, with unit normals, and as small objects."""
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.tolerance import TINY

Values = TypeVar('Values', FloatArray, ComplexArray)


class PointSequence(NamedTuple):
    """The P points of a scan in beam order, cut into surfaces.

    Attributes
    ----------
    points : (P,) complex [m]
        Positions in the frame of the sensor.
    radius : (P,) float [m]
        Range of each point.
    beams : (P,) int
    moments : (5, P + 1) float
        Sums of x, y, xx, xy, yy before each point: the difference of two columns is the sum over a range of points.
    breaks : (P - 1,) bool
        True where a point and the next lie on different surfaces.
    increment : float [rad]
        Step from one beam to the next.
    """

    points: ComplexArray
    radius: FloatArray
    beams: IntArray
    moments: FloatArray
    breaks: BoolArray
    increment: float


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
        step = spacing(len(self), count)
        # Contiguous copies: with numpy 1.26 the last bit of a product over strided arrays depends on their address.
        return self if step <= 1 else self.select(np.arange(0, len(self), step))


def spacing(size: int, count: int) -> int:
    """Return the index step with which at most `count` of `size` points are selected."""
    return -(-size // count)


class SmallObjects(NamedTuple):
    """The T small objects of a scan.

    Attributes
    ----------
    beam : (T,) int
        First beam with a return from each object.
    returns : (T,) int
        Number of returns from each object.
    nearest : (T,) float [m]
        Smallest range of each object.
    front : (T,) complex [m]
        Midpoint of the first and the last point of each object.
    width : (T,) float [m]
        Width of each object: the width covered by `returns` beams at the distance of `front`.
    without_normals : (T,) bool
        Whether no point of the object has a normal.
    """

    beam: IntArray
    returns: IntArray
    nearest: FloatArray
    front: ComplexArray
    width: FloatArray
    without_normals: BoolArray

    @property
    def middle(self) -> ComplexArray:
        """``(T,)`` complex [m]: centre of each object, under the assumption that it is round."""
        return self.front * ((self.nearest + 0.5 * self.width) / np.maximum(np.abs(self.front), TINY))
