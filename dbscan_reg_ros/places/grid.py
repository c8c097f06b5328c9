# SPDX-License-Identifier: Apache-2.0
"""Occupancy grids as maps: distances to the nearest surface, and views cast from free cells."""
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se2 import SE2
from ..core.parameters.tree import Parameters
from ..recordings.poses import compose
from ..robot.occupancy import FREE, OCCUPIED, UNKNOWN, OccupancyCounts, trace_rays
from .map import Map

RESOLUTION = 0.05
"""Side [m] of the cells of the grid of a map of key frames."""
CLEARANCE = 0.25
"""Views are cast from cells at least this far [m] from every surface."""
REACH = 30.0
"""Rays are cut off at this length [m]."""


class Grid:
    """An occupancy grid in which rays are cast.

    Parameters
    ----------
    values : (H, W) int8
        `FREE`, `OCCUPIED` or `UNKNOWN`; the rows are in the order of y.
    origin : SE2
        Pose in the map of the corner of ``values[0, 0]`` with the smallest x and y.
    resolution : float
        Side of a cell [m].
    """

    def __init__(self, values: NDArray[np.int8], origin: SE2, resolution: float) -> None:
        self.origin, self.resolution = origin, resolution
        # A border of unknown cells: whatever lies outside is looked up there.
        self.values = np.pad(values, 1, constant_values=UNKNOWN)

    @classmethod
    def of_map(cls, made: Map, parameters: Parameters, resolution: float = RESOLUTION) -> 'Grid':
        """Return the grid of what the views of a map of key frames saw."""
        counts = OccupancyCounts(resolution)
        for pose, view in zip(made.poses, made.views, strict=True):
            points = SE2.from_array(pose).apply(view.features(parameters).points)
            counts.add(trace_rays(points, pose[:2], resolution, REACH))
        grid = counts.grid()
        return cls(grid.values, SE2(*grid.corner), resolution)

    @cached_property
    def distance(self) -> NDArray[np.float32]:
        """``(H, W)`` distance [m] from the centre of each cell to that of the nearest occupied cell."""
        from scipy.ndimage import distance_transform_edt
        return (self.resolution * distance_transform_edt(self.values != OCCUPIED)).astype(np.float32)

    def cells(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the number (N,) of the cell of each of the `points` (N, 2) [m] in the map, counted row by row."""
        return self._cells(*self.origin.inverse().apply(points).T)

    def _cells(self, x, y):
        height, width = self.values.shape
        column = np.clip(np.floor(x / self.resolution).astype(np.int64) + 1, 0, width - 1)
        row = np.clip(np.floor(y / self.resolution).astype(np.int64) + 1, 0, height - 1)
        return row * width + column

    def free_poses(self, spacing: float) -> NDArray[np.float64]:
        """Return poses (N, 3) of heading 0 in the grid, one in each square of side `spacing` [m] with a free cell.

        In each square it is the free cell that is farthest from all surfaces, if that is at least `CLEARANCE`.
        """
        from scipy.ndimage import distance_transform_edt
        known = self.resolution * distance_transform_edt(self.values >= FREE)
        clear = np.where(self.values == FREE, np.minimum(self.distance, known), 0.0)
        rows, columns = np.nonzero(clear >= CLEARANCE)
        if not len(rows):
            return np.empty((0, 3))
        side = max(round(spacing / self.resolution), 1)
        square = rows // side * (clear.shape[1] // side + 1) + columns // side
        # The clearance in steps of the cells, then nearest to the middle of the square: a corridor has views in line.
        off = np.hypot(rows % side - 0.5 * side, columns % side - 0.5 * side)
        order = np.lexsort((off, -np.minimum(clear[rows, columns], 0.5 * spacing).round(2), square))
        first = order[np.unique(square[order], return_index=True)[1]]
        centre = (np.column_stack((columns[first], rows[first])) - 0.5) * self.resolution
        return compose(np.repeat(self.origin.as_array()[None], len(centre), axis=0),
                       np.column_stack((centre, np.full(len(centre), -self.origin.theta))))

    def cast(self, poses: NDArray[np.float64], bearings: NDArray[np.float64], reach: float = REACH
             ) -> NDArray[np.float64]:
        """Return the range (N, B) [m] from each of the `poses` (N, 3) in the map along each of the `bearings` (B,).

        A ray that leaves what is known, or is longer than `reach`, has no return: its range is infinite.
        """
        local = compose(np.repeat(self.origin.inverse().as_array()[None], len(poses), axis=0), poses)
        angle = (local[:, 2, None] + bearings).ravel()
        x, y = np.repeat(local[:, :2], len(bearings), axis=0).T
        ranges, travelled = np.full(len(angle), np.inf), np.zeros(len(angle))
        c, s = np.cos(angle), np.sin(angle)
        values, distance = self.values.ravel(), self.distance.ravel()
        active = np.arange(len(angle))
        while len(active):
            along = travelled[active]
            cell = self._cells(x[active] + along * c[active], y[active] + along * s[active])
            hit = values[cell] == OCCUPIED
            ranges[active[hit]] = along[hit]
            # From within a cell the nearest surface is at least 1.5 cells' diagonals nearer than between the centres.
            step = np.maximum(distance[cell] - 1.5 * self.resolution, 0.5 * self.resolution)
            on = ~hit & (values[cell] == FREE) & (along + step < reach)
            active = active[on]
            travelled[active] += step[on]
        return ranges.reshape(len(poses), len(bearings))

