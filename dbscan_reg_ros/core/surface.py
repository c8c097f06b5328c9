# SPDX-License-Identifier: Apache-2.0
"""What a scan knows of the space around it: its surfaces, for look-up by place, and its free space, by bearing."""
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from .parameters import DensityParameters
from .se2 import as_complex

_AT_ONCE = 2**22
"""So many cells are written in one step, however far the points reach."""


@dataclass(frozen=True, eq=False)
class Cloud:
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
    worth: np.ndarray | None = None
    sharpness: np.ndarray | None = None

    def __len__(self):
        return len(self.points)

    def select(self, chosen):
        """The points that `chosen`, a mask or indices, picks."""
        worth, sharpness = (part if part is None else part[chosen] for part in (self.worth, self.sharpness))
        return Cloud(self.points[chosen], self.normals[chosen], self.beams[chosen], worth, sharpness)

    def joined(self, other):
        """These points and then those of another cloud, all of them sharp."""
        parts = (self.points, other.points), (self.normals, other.normals), (self.beams, other.beams)
        worth = np.concatenate([each.weighed(np.ones(len(each))) for each in (self, other)])
        return Cloud(*map(np.concatenate, parts), worth)

    def weighed(self, weight):
        """A `weight` ``(..., P)`` of the points times what they count."""
        return weight if self.worth is None else weight * self.worth

    def sharpened(self, values):
        """`values` ``(..., P)`` in units of each point's noise, where that is unusual."""
        return values if self.sharpness is None else values * self.sharpness

    def tolerance(self, distance):
        """A `distance` [m] that is more for points noisier than others."""
        return distance if self.sharpness is None else distance / self.sharpness

    def thinned(self, count):
        """At most `count` of the points, evenly along the scan."""
        step = stride(len(self), count)
        # A copy: with arrays that skip, the last bit of a product depends in numpy 1.26 on where in memory they lie.
        return self if step <= 1 else self.select(np.arange(0, len(self), step))


def stride(size, count):
    """The step from one point to the next where at most `count` of `size` are kept."""
    return -(-size // count)


def build_cloud(points, normals, beams) -> Cloud:
    """The `Cloud` of a scan from its points and normals ``(P, 2)``, those without a normal left out."""
    normals = as_complex(normals)
    known = normals != 0.0
    return Cloud(as_complex(points)[known], normals[known], beams[known])


def leverage(cloud: Cloud, balance):
    """Weight ``(P,)`` of each point, in sum 1: more where few points face the same way.

    In a corridor the few points that face along it decide, not the hundreds on its walls. The weight is the statistical
    leverage of the point's normal, with `balance` as ridge: large values make all points equal.
    """
    size = max(len(cloud), 1)
    nx, ny = cloud.normals.real, cloud.normals.imag
    xx, xy, yy = nx @ nx / size + balance, nx @ ny / size, ny @ ny / size + balance
    weight = cloud.weighed(yy * nx * nx - 2.0 * xy * nx * ny + xx * ny * ny)
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


def sample(cloud: Cloud, count):
    """At most `count` of the points, evenly along the scan, and all of `high_leverage`: in a corridor those decide."""
    if len(cloud) <= count:
        return cloud
    chosen = high_leverage(cloud.normals)
    chosen[::stride(len(cloud), count)] = True
    return cloud.select(chosen.nonzero()[0])


@dataclass(frozen=True, eq=False)
class Surface:
    """Oriented points behind a grid that names the nearest of them: the reference density as a table (Eq. 16-18).

    The Gaussian kernel of the density estimate is taken of the nearest point's line only: one look-up a point instead of
    a sum over all.

    Attributes
    ----------
    origin : complex [m]
        Corner of the grid.
    cell : float [m]
    shape : (int, int)
        Cells along x and y.
    index : (cells,) int
        Nearest point of each cell; the last point, which has no normal, where none is near.
    normals : (P + 1,) complex
        Unit normals, 0 for the last, conjugated: a product with one is the part along it and the part across.
    offsets : (P + 1,) float [m]
        Distance of each point's line from the sensor, along its normal.
    along : (P + 1,) float [m]
        Where each point lies along its line.
    extents : (P + 1,) float [m]
        So far along its line, on either side, each point stands for the surface: as far as to the nearer of its neighbours, at
        least for a cell. What lies beyond the end of a wall says nothing of where that is.
    """

    origin: complex
    cell: float
    shape: tuple
    index: np.ndarray
    normals: np.ndarray
    offsets: np.ndarray
    along: np.ndarray
    extents: np.ndarray

    def nearest(self, places):
        """Index of the point nearest to each of the `places` (complex, any shape, [m])."""
        at = places - self.origin
        at *= 1.0 / self.cell
        at = np.ravel_multi_index((at.real.astype(np.intp), at.imag.astype(np.intp)), self.shape, mode='clip')
        return self.index.take(at).astype(np.intp)


def build_surface(cloud: Cloud, parameters: DensityParameters) -> Surface:
    """The `Surface` of all points of a scan that have a normal."""
    size, x, y = len(cloud), cloud.points.real, cloud.points.imag
    low, high = (complex(x.min(), y.min()), complex(x.max(), y.max())) if size else (0j, 0j)
    wide = high - low
    cell = max(parameters.cell, (max(wide.real, wide.imag) + 2.0 * parameters.reach) / parameters.cells)
    # One cell for rounding, and one near nothing all around: what lies beyond it is looked up there.
    margin = int(math.ceil(parameters.reach / cell)) + 2
    origin = low - complex(margin, margin) * cell
    rows, columns = (int(side / cell) + 2 * margin + 1 for side in (wide.real, wide.imag))
    # The table is large and is looked up everywhere: small numbers keep it in the cache.
    kind = np.min_scalar_type(size)
    index = np.full(rows * columns, size, dtype=kind)
    x, y = (x - origin.real) / cell, (y - origin.imag) / cell
    row, column = x.astype(np.intp), y.astype(np.intp)
    x, y = x - row - 0.5, y - column - 0.5
    order = (-(x * x + y * y)).argsort(kind='stable').astype(kind)
    home = (row * columns + column)[order]
    index[home] = order
    # Of the points in one cell, the one closest to its centre wins everywhere: the others need not be written. Written
    # from the far offsets to the near ones, the nearest point has the last word. A fixed order among equals, as that of the
    # beams or of the offsets, would favour the points on one side and draw every match that way.
    winner = index[home] == order
    home, order = home[winner], order[winner]
    row, column = _disc(parameters.reach / cell)
    away, some = row * columns + column, max(_AT_ONCE // max(len(order), 1), 1)
    quarter = 2 * (x.take(order) > 0.0) + (y.take(order) > 0.0)
    # One long list of places is written twice as fast as a table of them.
    for first in range(0, len(away), some):
        places = away[first:first + some].take(quarter, axis=1)
        places += home
        index[places.ravel()] = np.tile(order, len(places))
    normals = np.append(cloud.normals.conj(), 0.0)
    parts = normals * np.append(cloud.points, 0.0)
    gaps = np.concatenate(([np.inf], np.abs(cloud.points[1:] - cloud.points[:-1]), [np.inf]))
    extents = np.maximum(np.append(np.minimum(gaps[1:], gaps[:-1])[:size], 0.0), cell)
    return Surface(origin, cell, (rows, columns), index, normals, parts.real.copy(), parts.imag.copy(), extents)


@lru_cache(maxsize=4)
def _disc(radius):
    """Row and column offsets ``(K, 4)`` of the cells of a disc, from the far ones to the near ones, for points in each quarter
    of the cell in its middle.
    """
    reach = int(math.ceil(radius))
    side = np.arange(-reach, reach + 1)
    row, column = np.nonzero(side[:, None] ** 2 + side ** 2 <= radius * radius)
    row, column = side[row, None], side[column, None]
    order = np.argsort(-((row - _QUARTERS.real) ** 2 + (column - _QUARTERS.imag) ** 2), axis=0, kind='stable')
    return row[order, 0], column[order, 0]


_QUARTERS = np.array((-0.25 - 0.26j, -0.25 + 0.26j, 0.25 - 0.26j, 0.25 + 0.26j))
"""About the middles of the quarters of a cell, in cells; off the diagonals, where rows and columns would be equally far away."""


@dataclass(frozen=True, eq=False)
class View:
    """How far a scan saw in every direction.

    Attributes
    ----------
    near, far : (B,) float [m]
        Least and greatest range of the beams that touch each bin of the full circle; 0 where the scan does not know.
    """

    near: np.ndarray
    far: np.ndarray

    @cached_property
    def nearby(self):
        """`near`, the least of each bin and the two on either side of it, for bearings that are not known to a bin."""
        near = np.concatenate((self.near[-2:], self.near, self.near[:2]))
        return np.lib.stride_tricks.sliding_window_view(near, 5).min(axis=1)

    def bins(self, places):
        """Bin of each of the `places` (complex, [m]) as seen from the sensor."""
        return bins(places, len(self.near))

    def violation(self, places, tolerance):
        """1 for a place well in front of what the scan saw there, fading to 0 within the `tolerance` [m]."""
        return in_front(np.abs(places), self.near.take(self.bins(places)), tolerance)


def bins(places, size):
    """Of so many bins of the full circle, that of each of the `places` (complex, [m])."""
    # Of numbers that lie side by side an angle takes a third of the time.
    bearing = np.arctan2(places.imag.copy(), places.real.copy())
    bearing += math.pi
    bearing *= size / (2.0 * math.pi)
    return np.minimum(bearing.astype(np.intp), size - 1)


def in_front(radius, near, tolerance):
    """1 where a `radius` is well below `near`, fading to 0 within the `tolerance` [m]."""
    front = near - radius
    front -= tolerance
    front *= 1.0 / tolerance
    np.maximum(front, 0.0, out=front)
    return np.minimum(front, 1.0, out=front)


@lru_cache(maxsize=4)
def _edges(size):
    """Bearings [rad] between which the bins of the full circle lie, so many of them."""
    return np.arange(size + 1) * (2.0 * math.pi / size) - math.pi


def build_view(points, increment) -> View:
    """The `View` of a scan from its filtered points ``(P, 2)``.

    A bin is known when beams on both of its sides have a return, no farther apart than three increments.
    """
    size = min(max(round(2.0 * math.pi / abs(increment)), 60), 2880)
    bearing, radius = np.arctan2(points[:, 1], points[:, 0]), np.abs(as_complex(points))
    order = bearing.argsort(kind='stable')
    bearing, radius = bearing[order], radius[order]
    bearing = np.concatenate((bearing[-1:] - 2.0 * math.pi, bearing, bearing[:1] + 2.0 * math.pi))
    radius = np.concatenate((radius[-1:], radius, radius[:1]))
    edges = _edges(size)
    before = bearing.searchsorted(edges, 'right') - 1
    after = before + (bearing[before] < edges)
    # A moved scan is sparse in places: what counts is that both neighbours exist, not that they are in adjacent beams.
    known = bearing[after[1:]] - bearing[before[:-1]] < 3.0 * max(abs(increment), 2.0 * math.pi / size)
    ends = radius[before[1:]], radius[after[1:]]
    near = np.minimum(np.minimum.reduceat(radius, before)[:-1], np.minimum(*ends))
    far = np.maximum(np.maximum.reduceat(radius, before)[:-1], np.maximum(*ends))
    return View(near * known, far * known)
