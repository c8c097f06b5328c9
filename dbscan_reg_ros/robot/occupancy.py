# SPDX-License-Identifier: Apache-2.0
"""Occupancy grids from scans with known poses, by ray tracing; used by the node and by replays.

A cell has whole numbers (x, y) and covers [x, x + 1) times [y, y + 1) resolutions of the map frame.
"""
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.errors import DbscanRegError

FREE, OCCUPIED, UNKNOWN = 0, 100, -1
"""Values of the cells of a nav_msgs/OccupancyGrid."""
LEAST_HITS = 0.25
"""A cell is occupied if at least this fraction of the scans that observe it have a return in it: the rays of other
scans graze a wall, and moving objects are hit by few scans."""
LARGEST = 25_000_000
"""Largest number of cells of a grid."""
NOT_SEEN, PASSED, HIT = 0, 1, 2
"""States of a cell in one scan."""


class GridError(DbscanRegError, ValueError):
    """A grid would have too many cells."""


class Patch(NamedTuple):
    """Cells that one scan observes."""

    corner: NDArray[np.int64]
    """Numbers (x, y) of the cell ``states[0, 0]`` ``(2,)`` int."""
    states: NDArray[np.uint8]
    """`NOT_SEEN`, `PASSED` by a ray, or `HIT` ``(H, W)`` uint8; the rows are in the order of y."""


class OccupancyGrid(NamedTuple):
    """A map of cells."""

    values: NDArray[np.int8]
    """`FREE`, `OCCUPIED` or `UNKNOWN` ``(H, W)`` int8; the rows are in the order of y."""
    corner: tuple[float, float]
    """Position of the corner of ``values[0, 0]`` with the smallest x and y, in the map frame [m]."""
    resolution: float
    """Side of a cell [m]."""


def trace_rays(points: NDArray[np.float64], sensor: NDArray[np.float64], resolution: float, reach: float) -> Patch:
    """Trace the rays of a scan through the cells.

    Along the axis on which a ray passes more cells it has one sample in each cell. Rays that are longer than `reach`
    are cut off there, without a return.

    Parameters
    ----------
    points : (N, 2) float
        Returns in the map frame [m]; those that are not finite are ignored.
    sensor : (2,) float
        Position of the sensor in the map frame [m].
    resolution, reach : float
        [m]

    Raises
    ------
    GridError
        When the rays reach over more than `LARGEST` cells.
    """
    start = np.asarray(sensor, dtype=float) / resolution
    rays = points[np.isfinite(points).all(axis=1)] / resolution - start
    lengths = np.hypot(rays[:, 0], rays[:, 1]) * resolution
    far = lengths > reach
    rays[far] *= (reach / lengths[far])[:, None]
    samples = np.maximum(np.ceil(np.abs(rays).max(axis=1, initial=0.0)), 1.0).astype(int)
    ray = np.repeat(np.arange(len(rays)), samples)
    along = (np.arange(len(ray)) - (np.cumsum(samples) - samples)[ray]) / samples[ray]
    passed = np.floor(start + along[:, None] * rays[ray]).astype(int)
    hit = np.floor(start + rays[~far]).astype(int)
    both = np.concatenate((passed, hit, np.floor(start)[None].astype(int)))
    corner = both.min(axis=0)
    width, height = both.max(axis=0) - corner + 1
    _check_size(width, height, resolution)
    states = np.zeros((height, width), dtype=np.uint8)
    for cells, state in ((passed, PASSED), (hit, HIT)):
        states[cells[:, 1] - corner[1], cells[:, 0] - corner[0]] = state
    return Patch(corner, states)


class OccupancyCounts:
    """Counts, for each cell of `resolution` [m], the scans that pass it and that hit it; grows with the patches."""

    def __init__(self, resolution: float) -> None:
        self._resolution = resolution
        self._corner = np.zeros(2, dtype=int)
        self._counts = np.zeros((2, 0, 0), dtype=np.uint32)

    def add(self, patch: Patch) -> None:
        """Count the cells of a patch once.

        Raises a GridError when the grid would have more than `LARGEST` cells.
        """
        self._grow(patch)
        x, y = patch.corner - self._corner
        height, width = patch.states.shape
        for counts, state in zip(self._counts, (PASSED, HIT), strict=True):
            counts[y:y + height, x:x + width] += patch.states == state

    def _grow(self, patch: Patch) -> None:
        """Make room for a patch."""
        low, high = patch.corner, patch.corner + patch.states.shape[::-1]
        own_low, own_high = self._corner, self._corner + self._counts.shape[:0:-1]
        if self._counts.size and (low >= own_low).all() and (high <= own_high).all():
            return
        if self._counts.size:
            # A margin on the side that grows: else each scan of a long drive would copy the whole grid.
            margin = (own_high - own_low) // 4
            low = np.where(low < own_low, low - margin, own_low)
            high = np.where(high > own_high, high + margin, own_high)
        width, height = (int(side) for side in high - low)
        _check_size(width, height, self._resolution)
        grown = np.zeros((2, height, width), dtype=np.uint32)
        x, y = own_low - low if self._counts.size else (0, 0)
        grown[:, y:y + self._counts.shape[1], x:x + self._counts.shape[2]] = self._counts
        self._corner, self._counts = low, grown

    def grid(self) -> OccupancyGrid:
        """Return the grid of all cells that were observed."""
        passed, hit = self._counts
        seen = passed + hit
        values = np.full(seen.shape, UNKNOWN, dtype=np.int8)
        values[seen > 0] = FREE
        values[(hit > 0) & (hit >= LEAST_HITS * seen)] = OCCUPIED
        rows, columns = (np.flatnonzero((seen > 0).any(axis=axis)) for axis in (1, 0))
        if not len(rows):
            return OccupancyGrid(values[:0, :0], (0.0, 0.0), self._resolution)
        y, x = rows[0], columns[0]
        corner = (self._corner + np.array((x, y))) * self._resolution
        return OccupancyGrid(values[y:rows[-1] + 1, x:columns[-1] + 1], (float(corner[0]), float(corner[1])),
                             self._resolution)


def _check_size(width: int, height: int, resolution: float) -> None:
    """Raise a GridError for a grid with too many cells."""
    if width * height > LARGEST:
        raise GridError(f'a grid of {width} x {height} cells of {resolution:g} m; expected at most {LARGEST} cells: '
                        'use a larger resolution')
