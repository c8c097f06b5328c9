# SPDX-License-Identifier: Apache-2.0
"""The last part of a drive, and how well it suits a map at given poses."""
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.se2 import wrap
from ..robot.occupancy import FREE, OCCUPIED
from .evidence import INDEPENDENT
from .grid import Grid

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
        Returns, one for each square of `CELL`, and the points `FRONT` before them on their rays.
    passed : (M, 2) float [m]
        Points on rays, one for each square of `FREE_CELL` that rays pass.
    """

    pose: NDArray[np.float64]
    hits: NDArray[np.float64]
    fronts: NDArray[np.float64]
    passed: NDArray[np.float64]

    @classmethod
    def of(cls, pose: NDArray[np.float64], points: NDArray[np.float64]) -> 'Stop':
        """Return what a scan saw whose returns are `points` (N, 2) in the frame of the odometry."""
        along = np.arange(0.5 * FREE_CELL, REACH, FREE_CELL)
        offset = points - pose[:2]
        length = np.maximum(np.hypot(*offset.T), FREE_CELL)
        ray, step = np.nonzero(along < length[:, None] - CLEAR)
        passed = pose[:2] + (along[step] / length[ray])[:, None] * offset[ray]
        kept = _first_in_square(points)
        fronts = points - np.minimum(FRONT / length, 1.0)[:, None] * offset
        return cls(pose, points[kept], fronts[kept], passed[_first_in_square(passed, FREE_CELL)])


class Drive(NamedTuple):
    """What was seen along the last part of a drive, each place once, in the frame of the odometry.

    Attributes
    ----------
    hits, fronts : (N, 2) float [m]
        Returns, one for each square of `CELL`, and the points `FRONT` before them on their rays.
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


def placed(poses, points):
    """Return `points` (N, 2) of the odometry frame in the map (H, N, 2), if that frame has the `poses` (H, 3)."""
    c, s = np.cos(poses[:, 2, None]), np.sin(poses[:, 2, None])
    x, y = points.T
    return np.stack((poses[:, 0, None] + c * x - s * y, poses[:, 1, None] + s * x + c * y), axis=2)


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
        self.grid = grid
        distance = grid.distance.astype(float)
        slope = np.gradient(distance, grid.resolution)
        self._slope = np.stack((slope[1].ravel(), slope[0].ravel()), axis=1)

    def align(self, poses: NDArray[np.float64], returns: NDArray[np.float64], most: int = MOST,
              scales: NDArray[np.float64] = FROM_NEAR) -> Aligned:
        """Move each of the `poses` (H, 3) in the map of a frame to where its `returns` (N, 2) lie on surfaces.

        Of the returns about `most`, evenly drawn, are used.
        """
        poses = poses.copy()
        every = max(len(returns) // most, 1)
        points = returns[::every]
        # About the middle of the returns: there, rotation and translation are independent.
        middle = points.mean(axis=0)
        arm = points - middle
        poses[:, :2] = placed(poses, middle[None])[:, 0]
        turn = self.grid.origin.rotation()
        for scale in scales:
            at = placed(poses, arm)
            off, slope = self._nearest(at)
            slope = slope @ turn.T
            weight = 1.0 / (1.0 + (off / scale) ** 2) ** 2
            lever = at - poses[:, None, :2]
            rotated = slope[..., 1] * lever[..., 0] - slope[..., 0] * lever[..., 1]
            jacobian = np.concatenate((slope, rotated[..., None]), axis=2)
            weighted = weight[..., None] * jacobian
            normal = np.einsum('hni,hnj->hij', weighted, jacobian) + np.eye(3)
            poses -= np.linalg.solve(normal, np.einsum('hni,hn->hi', weighted, off)[..., None])[..., 0]
        poses[:, :2] = placed(poses, -middle[None])[:, 0]
        poses[:, 2] = wrap(poses[:, 2])
        variance = np.maximum((weight * off**2).sum(axis=1) / weight.sum(axis=1), (0.3 * self.grid.resolution) ** 2)
        return Aligned(poses, middle, every * (normal - np.eye(3)) / variance[:, None, None])

    def count(self, poses: NDArray[np.float64], drive: Drive) -> NDArray[np.float64]:
        """Count what agrees at each pose (H, 3) of the odometry frame in the map.

        Returns
        -------
        (H, 6) float
            Returns on a surface that is seen from its free side, in free space, and the others, whose surroundings the
            map does not know; free squares that are free, blocked by a surface that should have been seen, and unknown.
        """
        values = self.grid.values.ravel()
        hit, front, square = (self.grid.cells(placed(poses, points).reshape(-1, 2)).reshape(len(poses), -1)
                              for points in (drive.hits, drive.fronts, drive.free))
        reach = max(ON_SURFACE, 1.5 * self.grid.resolution)
        # From one to the other in steps of a cell, so that a pose between two cells does not count more than another.
        near = np.clip((reach - self._nearest(placed(poses, drive.hits))[0]) / self.grid.resolution + 0.5, 0.0, 1.0)
        on, off = near * (values[front] == FREE), (1.0 - near) * (values[hit] == FREE)
        free, blocked = values[square] == FREE, values[square] == OCCUPIED
        counted = (on, off, 1.0 - on - off, free, blocked, ~free & ~blocked)
        return np.column_stack([each.sum(axis=1) for each in counted]).astype(float)

    def _nearest(self, points):
        """Return the distance (H, N) of points (H, N, 2) from the nearest surface, and its gradient in the grid."""
        cell, off = self.grid.cells_and_offsets(points.reshape(-1, 2))
        slope = self._slope[cell]
        distance = np.abs(self.grid.distance.ravel()[cell] + (slope * off).sum(axis=1))
        return distance.reshape(points.shape[:2]), slope.reshape(points.shape)
