# SPDX-License-Identifier: Apache-2.0
"""Map that grows with each scan, in bounded memory."""
import numpy as np

from ...figures.plots import DensityMap

CELL = 0.05
"""Length of a cell of a small map [m]; it doubles whenever the map has more than `MOST_CELLS`."""
MOST_CELLS = 1500 * 1500
MARGIN = 2.0
"""Margin [m] that is added whenever the map is enlarged, so that it is enlarged seldom."""
LARGEST = 65535
FARTHEST = 1e5
"""Returns farther from the origin than this [m] are left out."""


class LiveMap:
    """Grid map that counts the returns in each `cell` [m]; `version` is the number of changes of the map so far."""

    def __init__(self) -> None:
        self.cell = CELL
        self.version = 0
        self._corner = np.zeros(2, dtype=int)
        self._counts = np.zeros((0, 0), dtype=np.uint16)

    @property
    def nbytes(self) -> int:
        """Memory that the cells use [bytes]."""
        return self._counts.nbytes

    def add(self, points) -> None:
        """Count the returns ``(P, 2)`` [m] of a scan."""
        points = points[(np.abs(points) < FARTHEST).all(axis=1)]
        if not len(points):
            return
        self._cover(points.min(axis=0), points.max(axis=0))
        columns, rows = (np.floor(points / self.cell).astype(int) - self._corner).T
        cells, counts = np.unique(rows * self._counts.shape[1] + columns, return_counts=True)
        flat = self._counts.reshape(-1)
        flat[cells] = np.minimum(flat[cells].astype(int) + counts, LARGEST)
        self.version += 1

    def density(self) -> DensityMap:
        """Return the current map as a `DensityMap`."""
        if not self._counts.size:
            return DensityMap(np.zeros((1, 1)), (-1.0, 1.0, -1.0, 1.0))
        seen = self._counts[self._counts > 0]
        # A table by count: the logarithm of each cell would take most of the time.
        full = np.log1p(np.quantile(seen, 0.95))
        ink = np.minimum(np.log1p(np.arange(int(seen.max()) + 1, dtype=np.float32)) / full, 1.0)
        (left, bottom), (height, width) = self._corner * self.cell, self._counts.shape
        return DensityMap(ink[self._counts], (left, left + width * self.cell, bottom, bottom + height * self.cell))

    def _cover(self, low, high) -> None:
        """Enlarge the map to contain the points `low` and `high` [m]; enlarge the cells if there would be too many."""
        while True:
            first, last = (np.floor(point / self.cell).astype(int) for point in (low, high))
            shape = np.array(self._counts.shape[::-1])
            if shape.all():
                if (first >= self._corner).all() and (last < self._corner + shape).all():
                    return
                first, last = np.minimum(first, self._corner), np.maximum(last, self._corner + shape - 1)
            margin = int(MARGIN / self.cell)
            first, last = first - margin, last + margin
            if np.prod(last - first + 1) <= MOST_CELLS:
                break
            self._coarsen()
        counts = np.zeros((last - first + 1)[::-1], dtype=np.uint16)
        column, row = self._corner - first
        counts[row:row + self._counts.shape[0], column:column + self._counts.shape[1]] = self._counts
        self._corner, self._counts = first, counts

    def _coarsen(self) -> None:
        """Merge each square of four cells into one cell."""
        self.cell *= 2.0
        corner = self._corner // 2
        height, width = self._counts.shape
        if self._counts.size:
            column, row = self._corner - 2 * corner
            padded = np.pad(self._counts, ((row, (height + row) % 2), (column, (width + column) % 2)))
            joined = padded.reshape(padded.shape[0] // 2, 2, padded.shape[1] // 2, 2).sum(axis=(1, 3), dtype=np.uint32)
            self._counts = np.minimum(joined, LARGEST).astype(np.uint16)
        self._corner = corner
