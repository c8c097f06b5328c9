# SPDX-License-Identifier: Apache-2.0
"""Likelihood field of a scan: a table with the nearest oriented point of each cell (Eq. 16-18)."""
from dataclasses import dataclass

import numpy as np

from ..geometry.array_types import ComplexArray, FloatArray, IntArray


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
