# SPDX-License-Identifier: Apache-2.0
"""Likelihood field of a scan: a table with the nearest oriented point of each cell (Eq. 16-18)."""
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..geometry.array_types import ComplexArray, FloatArray, IntArray
from ..geometry.tolerance import TINY
from ..parameters.registration import DensityParameters
from .oriented_points import OrientedPoints

_CELLS_AT_ONCE = 2**22
"""Number of cells that are written in one step, which limits the memory for far-reaching points."""


@dataclass(frozen=True, eq=False)
class LikelihoodField:
    """Oriented points and a grid with the index of the nearest point: the reference density as a table (Eq. 16-18).

    The Gaussian kernel of the density estimate is evaluated for the line of the nearest point only: one lookup replaces
    the sum over all points.

    Attributes
    ----------
    origin : complex [m]
        Corner of the grid with the smallest x and y, in the frame of the sensor.
    cell : float [m]
        Side of a cell.
    shape : (int, int)
        Cells along x and y.
    index : (cells,) int
        Index of the nearest point of each cell; P if there is no point near.
    normals : (P + 1,) complex
        Conjugated unit normals, the last one 0. Real and imaginary part of the product of such a normal with a vector
        are the components of the vector along and across the normal.
    offsets : (P + 1,) float [m]
        Distance of the line of each point from the sensor, along its normal.
    along : (P + 1,) float [m]
        Position of each point along its line.
    extents : (P + 1,) float [m]
        Half the length of the piece of line that each point represents: the distance to its nearer neighbour, but at
        least a cell. Points beyond the end of a wall do not constrain the position along it.
    """

    origin: complex
    cell: float
    shape: tuple[int, int]
    index: IntArray
    normals: ComplexArray
    offsets: FloatArray
    along: FloatArray
    extents: FloatArray

    def nearest(self, points: ComplexArray) -> IntArray:
        """Look up the index of the point nearest to each of the `points` (complex, any shape, [m])."""
        position = points - self.origin
        position *= 1.0 / self.cell
        cells = position.real.astype(np.intp), position.imag.astype(np.intp)
        return self.index.take(np.ravel_multi_index(cells, self.shape, mode='clip')).astype(np.intp)


def build_likelihood_field(oriented: OrientedPoints, parameters: DensityParameters) -> LikelihoodField:
    """Build the `LikelihoodField` of oriented points."""
    size, x, y = len(oriented), oriented.points.real, oriented.points.imag
    low, high = (complex(x.min(), y.min()), complex(x.max(), y.max())) if size else (0j, 0j)
    wide = high - low
    cell = max(parameters.cell_size, (max(wide.real, wide.imag) + 2.0 * parameters.max_distance) / parameters.max_cells)
    # One cell for rounding, and a border of cells without a point: lookups beyond the grid end there.
    margin = math.ceil(parameters.max_distance / cell) + 2
    origin = low - complex(margin, margin) * cell
    rows, columns = (int(side / cell) + 2 * margin + 1 for side in (wide.real, wide.imag))
    positions = (x - origin.real) / cell, (y - origin.imag) / cell
    index = _nearest_points(positions, (rows, columns), parameters.max_distance / cell)
    normals = np.append(oriented.normals.conj(), 0.0)
    parts = normals * np.append(oriented.points, 0.0)
    gaps = np.concatenate(([np.inf], np.abs(oriented.points[1:] - oriented.points[:-1]), [np.inf]))
    extents = np.maximum(np.append(np.minimum(gaps[1:], gaps[:-1])[:size], 0.0), cell)
    return LikelihoodField(origin=origin, cell=cell, shape=(rows, columns), index=index, normals=normals,
                           offsets=parts.real.copy(), along=parts.imag.copy(), extents=extents)


def _nearest_points(points: tuple[FloatArray, FloatArray], shape: tuple[int, int], reach: float) -> IntArray:
    """Return the index of the nearest point for every cell of a grid.

    Parameters
    ----------
    points : (P,) float, (P,) float
        Positions x and y in the grid, in cells.
    shape : (int, int)
        Cells along x and y.
    reach : float
        Distance in cells beyond which no point counts as the nearest.

    Returns
    -------
    (cells,) int
        P where no point is near.
    """
    (x, y), (rows, columns) = points, shape
    size = len(x)
    # The table is large and looked up at random: small integers keep it in the cache.
    kind = np.min_scalar_type(size)
    index = np.full(rows * columns, size, dtype=kind)
    row, column = x.astype(np.intp), y.astype(np.intp)
    x, y = x - row - 0.5, y - column - 0.5
    order = np.rint((x * x + y * y) * (-1.0 / TINY)).argsort(kind='stable').astype(kind)
    home = (row * columns + column)[order]
    index[home] = order
    # Of the points in one cell only the one closest to its centre is written. Offsets are written from far to near, so
    # that the nearest point remains. A fixed order among equals, as that of the beams or of the offsets, would favour
    # the points on one side and bias every match in that direction.
    winner = index[home] == order
    home, order = home[winner], order[winner]
    row_offset, column_offset = _disc(reach)
    offsets, some = row_offset * columns + column_offset, max(_CELLS_AT_ONCE // max(len(order), 1), 1)
    quarter = 2 * (x.take(order) > 0.0) + (y.take(order) > 0.0)
    # One long list of cells is written twice as fast as a two-dimensional one.
    for first in range(0, len(offsets), some):
        cells = offsets[first:first + some].take(quarter, axis=1)
        cells += home
        index[cells.ravel()] = np.tile(order, len(cells))
    return index


@lru_cache(maxsize=2)
def _disc(radius: float) -> tuple[IntArray, IntArray]:
    """Return row and column offsets ``(K, 4)`` of the cells of a disc with a `radius` in cells, from far to near.

    Each column is sorted by the distance from a point in one quarter of the middle cell (`_QUARTERS`).
    """
    reach = math.ceil(radius)
    side = np.arange(-reach, reach + 1)
    row, column = np.nonzero(side[:, None] ** 2 + side ** 2 <= radius * radius)
    row, column = side[row, None], side[column, None]
    order = np.argsort(-((row - _QUARTERS.real) ** 2 + (column - _QUARTERS.imag) ** 2), axis=0, kind='stable')
    return row[order, 0], column[order, 0]


_QUARTER = 0.25 + 0.26j
_QUARTERS = np.array((-_QUARTER, -_QUARTER.conjugate(), _QUARTER.conjugate(), _QUARTER))
"""Points near the middles of the quarters of a cell, in cells; off the diagonals, where rows and columns would tie."""
