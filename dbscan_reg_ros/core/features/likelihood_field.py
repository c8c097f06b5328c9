# SPDX-License-Identifier: Apache-2.0
"""Likelihood field of a scan: a table that names the nearest oriented point of each cell (Eq. 16-18)."""
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..parameters.registration import DensityParameters
from .oriented_points import OrientedPoints

_AT_ONCE = 2**22
"""So many cells are written in one step, however far the points reach."""


@dataclass(frozen=True, eq=False)
class LikelihoodField:
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


def build_likelihood_field(cloud: OrientedPoints, parameters: DensityParameters) -> LikelihoodField:
    """The `LikelihoodField` of all points of a scan that have a normal."""
    size, x, y = len(cloud), cloud.points.real, cloud.points.imag
    low, high = (complex(x.min(), y.min()), complex(x.max(), y.max())) if size else (0j, 0j)
    wide = high - low
    cell = max(parameters.cell_size, (max(wide.real, wide.imag) + 2.0 * parameters.max_distance) / parameters.max_cells)
    # One cell for rounding, and one near nothing all around: what lies beyond it is looked up there.
    margin = int(math.ceil(parameters.max_distance / cell)) + 2
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
    row, column = _disc(parameters.max_distance / cell)
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
    return LikelihoodField(origin, cell, (rows, columns), index, normals, parts.real.copy(), parts.imag.copy(), extents)


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
