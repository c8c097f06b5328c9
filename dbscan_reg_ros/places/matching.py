# SPDX-License-Identifier: Apache-2.0
"""The last part of a drive, and how well it suits a map at given poses."""
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.features.records import Features
from ..core.geometry.se2 import SE2, turn_matrix, wrap
from ..recordings.poses import compose, relative
from .evidence import INDEPENDENT
from .grid import Grid
from .surface_lookup import SurfaceLookup

CELL = 0.1
"""Returns of a drive that lie in one square of this side [m] count once."""
FREE_CELL = 0.2
"""Free space of a drive that lies in one square of this side [m] counts once."""
CLEAR = 0.3
"""Free space nearer than this [m] to a return does not count, because of errors of poses and walls seen at a slant."""
ON_SURFACE = 0.075
"""A return is on a surface of the map up to this distance [m] from it, or in a cell that touches it: the
more exact, the better are right poses told from wrong ones that suit the drive by chance."""
FROM_AFAR = np.geomspace(0.5, 0.15, 7)
"""Scale [m] of the robust kernel in each Gauss-Newton iteration of an alignment that begins at a view."""
FROM_NEAR = np.full(3, 0.1)
"""The same for one that begins at an aligned pose."""
MOST = 400
"""Number of returns that are aligned."""
FRONT = 0.25
"""So far [m] before a surface the map is free: a wall was not seen from its back."""
SEEN_THROUGH = 2
"""A return is of something that moved if the rays of so many scans pass its square and all squares around it: along a
wall some of these lie behind it."""
REACH = 15.0
"""Free space farther than this [m] from the sensor does not count."""
_OFFSET = 2**20
"""Difference of the numbers of two squares that are neighbours in x; a map has fewer squares in y."""


class Stop(NamedTuple):
    """What one scan saw, in the frame of the odometry.

    Attributes
    ----------
    pose : (3,) float [m, m, rad]
        Of the sensor.
    hits, fronts : (N, 2) float [m]
        Returns, one for each square of `CELL`, and the points `FRONT` before them along their normals, or their rays
        where there are none.
    passed : (M, 2) float [m]
        Points on rays, one for each square of `FREE_CELL` that rays pass.
    """

    pose: NDArray[np.float64]
    hits: NDArray[np.float64]
    fronts: NDArray[np.float64]
    passed: NDArray[np.float64]

    @classmethod
    def of(cls, pose: SE2, features: Features) -> 'Stop':
        """Return what a scan with these `features` saw, if its sensor has this pose in the frame of the odometry."""
        points, sensor = pose.apply(features.points), pose.as_array()
        along = np.arange(0.5 * FREE_CELL, REACH, FREE_CELL)
        offset = points - sensor[:2]
        length = np.maximum(np.hypot(*offset.T), FREE_CELL)
        ray, step = np.nonzero(along < length[:, None] - CLEAR)
        passed = sensor[:2] + (along[step] / length[ray])[:, None] * offset[ray]
        kept = _first_in_square(points)
        # A ray along a wall stays in the unknown behind it: where there is a normal, it leads away from the wall.
        before = np.where(features.normals.any(axis=1, keepdims=True), FRONT * features.normals @ pose.rotation().T,
                          -np.minimum(FRONT / length, 1.0)[:, None] * offset)
        fronts = points + before
        return cls(sensor, points[kept], fronts[kept], passed[_first_in_square(passed, FREE_CELL)])


class Drive(NamedTuple):
    """What was seen along the last part of a drive, each place once, in the frame of the odometry.

    Attributes
    ----------
    hits, fronts : (N, 2) float [m]
        Returns, one for each square of `CELL`, and the points `FRONT` before them along their normals, or their rays
        where there are none.
    free : (M, 2) float [m]
        Points on rays, one for each free square of `FREE_CELL`.
    """

    hits: NDArray[np.float64]
    fronts: NDArray[np.float64]
    free: NDArray[np.float64]

    @classmethod
    def of(cls, stops: list[Stop]) -> 'Drive':
        """Return what was seen from the `stops`."""
        hits, fronts, passed = (np.concatenate([getattr(stop, name) for stop in stops])
                                for name in ('hits', 'fronts', 'passed'))
        free, first, times = np.unique(_squares(passed, FREE_CELL), return_index=True, return_counts=True)
        around = np.array([x * _OFFSET + y for x in (-1, 0, 1) for y in (-1, 0, 1)])
        squares = _squares(hits, FREE_CELL)[:, None] + around
        # What other scans saw through, all around, has moved.
        static = ~np.isin(squares, free[times >= SEEN_THROUGH]).all(axis=1)
        hits, fronts = hits[static], fronts[static]
        kept = _first_in_square(hits)
        return cls(hits[kept], fronts[kept], passed[first[~np.isin(free, squares[static])]])


def _first_in_square(points, side=CELL):
    """Return the numbers of the first of the `points` (N, 2) in each square of this `side` [m]."""
    return np.sort(np.unique(_squares(points, side), return_index=True)[1])


def _squares(points, side):
    """Return a number (N,) for the square of this `side` [m] in which each of the `points` (N, 2) lies."""
    return np.floor(points / side).astype(np.int64) @ np.array([_OFFSET, 1])


class Aligned(NamedTuple):
    """Returns aligned with a map.

    Attributes
    ----------
    poses : (H, 3) float [m, m, rad]
        Of the odometry frame in the map.
    middle : (2,) float [m]
        The middle of the returns, in the odometry frame.
    information : (H, 3, 3) float
        Of the position of `middle` in the map and of the heading, if each return is independent of the others.
    """

    poses: NDArray[np.float64]
    middle: NDArray[np.float64]
    information: NDArray[np.float64]

    def covariance(self, number: int) -> NDArray[np.float64]:
        """Return the covariance (3, 3) of one of the poses, for the position of `middle` and the heading."""
        found: NDArray[np.float64] = np.linalg.inv(self.information[number] / INDEPENDENT + np.eye(3))
        return found


class Matcher:
    """Aligns a drive with a grid, and counts what agrees."""

    def __init__(self, grid: Grid) -> None:
        self._origin, self._reach = grid.origin.as_array(), max(ON_SURFACE, 1.5 * grid.resolution)
        self._least = (0.3 * grid.resolution) ** 2
        self._lookup = SurfaceLookup(grid.values, grid.distance, grid.resolution)

    def align(self, poses: NDArray[np.float64], returns: NDArray[np.float64], most: int = MOST,
              scales: NDArray[np.float64] = FROM_NEAR) -> Aligned:
        """Move each of the `poses` (H, 3) in the map of a frame to where its `returns` (N, 2) lie on surfaces.

        Of the returns about `most`, evenly drawn, are used.
        """
        every = max(len(returns) // most, 1)
        points = returns[::every]
        # About the middle of the returns: there, rotation and translation are independent.
        middle = points.mean(axis=0)
        moved = self._in_grid(_at(poses, middle))
        normal, variance = self._lookup.align(moved, points - middle, scales)
        moved = _at(compose(np.repeat(self._origin[None], len(moved), axis=0), moved), -middle)
        moved[:, 2] = wrap(moved[:, 2])
        turn = turn_matrix(self._origin[2])
        return Aligned(moved, middle,
                       turn @ (every / np.maximum(variance, self._least)[:, None, None] * normal) @ turn.T)

    def count(self, poses: NDArray[np.float64], drive: Drive) -> NDArray[np.float64]:
        """Count what agrees at each pose (H, 3) of the odometry frame in the map.

        Returns
        -------
        (H, 6) float
            Returns on a surface that is seen from its free side, in free space, and the others, whose surroundings the
            map does not know; free squares that are free, blocked by a surface that should have been seen, and unknown.
        """
        return self._lookup.count(self._in_grid(poses), drive.hits, drive.fronts, drive.free, self._reach)

    def _in_grid(self, poses):
        """Return `poses` (H, 3) in the map in the frame of the grid."""
        return relative(np.repeat(self._origin[None], len(poses), axis=0), poses)


def _at(poses, point):
    """Return the poses (H, 3) of a frame with its origin moved to a `point` (2,)."""
    return compose(poses, np.repeat(np.append(point, 0.0)[None], len(poses), axis=0))
