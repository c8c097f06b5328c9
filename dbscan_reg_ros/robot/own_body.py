# SPDX-License-Identifier: Apache-2.0
"""Directions in which a lidar sees the robot itself."""
import itertools
import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.mounting import Mounting
from ..core.geometry.se2 import SE2
from ..core.scan import Scan
from .parameter_groups import SECTORS as MOST

DISTANCE, ROTATION = 0.2, 0.2
"""A scan is compared when the lidar has moved by one of these since the last compared scan [m, rad]. Of a rotation
during which scans are missing, at most twice this is counted."""
COMPARED = 40
"""Number of the latest compared scans, even: they cover about 8 m or less."""
LEAST_DISTANCE, LEAST_ROTATION = 2.0, 2.0
"""Shortest distance [m] and smallest rotation [rad] that they cover: a wall along the path has the same range until the
robot turns, and a circular room until it drives."""
EVERY = 5
"""The compared scans are searched each time this number has been added."""
SECTORS = 180
"""Number of sectors around the lidar; of each the smallest range is compared."""
TOLERANCE = 0.03, 0.01
"""A range is the same if it differs from the median by at most this [m] plus this fraction of the median."""
SAME = 0.9
"""Fraction of the compared scans that must have the same range: there are outliers."""
MARGIN = 2.0 * math.pi / SECTORS
"""A sector is wider by this [rad] at both ends than where the robot is seen: it may cover a part of the next one."""
FARTHEST = 3.0
"""Largest range [m] of a return from the robot: drivers send constant large ranges where there is no return."""


class BodySector(NamedTuple):
    """A sector in which the robot itself is seen."""

    first: float
    last: float
    """Bearings, counter-clockwise in the frame of the scan [rad]."""
    range: float
    """Smallest median range [m]."""

    def in_lidar(self, mounting: Mounting) -> 'BodySector':
        """Return the sector in the frame of the lidar, if that of the scan has the axes of the base."""
        first, last = self.first - mounting.pose.theta, self.last - mounting.pose.theta
        if mounting.upside_down:
            first, last = -last, -first
        width = last - first
        first = math.remainder(first, 2.0 * math.pi)
        return BodySector(first, math.remainder(first + width, 2.0 * math.pi), self.range)


class OwnBody:
    """Finds the `sectors` in which the range of a lidar stays the same while the robot drives and turns, by bearing."""

    def __init__(self) -> None:
        self.sectors: list[BodySector] = []
        self._compared: deque[tuple[float, float, NDArray[np.float64]]] = deque(maxlen=COMPARED)
        self._last: SE2 | None = None
        self._new = 0

    def add(self, scan: Scan, pose: SE2) -> None:
        """Add a scan without masked returns, which a lidar measured at a `pose`; update the `sectors`."""
        motion = SE2() if self._last is None else self._last.inverse() @ pose
        distance, rotation = math.hypot(motion.x, motion.y), min(abs(motion.theta), 2.0 * ROTATION)
        if self._last is not None and distance < DISTANCE and rotation < ROTATION:
            return
        self._last = pose
        self._compared.append((distance, rotation, _nearest(scan)))
        self._new = (self._new + 1) % EVERY
        if self._new == 0 and len(self._compared) == COMPARED:
            self._search()

    def restart(self) -> None:
        """Forget the last pose: the odometry was reset."""
        self._last = None

    def _search(self) -> None:
        """Update the `sectors` from the compared scans."""
        distances, rotations, ranges = zip(*self._compared, strict=True)
        if sum(distances) < LEAST_DISTANCE or sum(rotations) < LEAST_ROTATION:
            return
        table = np.array(ranges)
        table.sort(axis=0)
        middle = 0.5 * (table[COMPARED // 2 - 1] + table[COMPARED // 2])
        with np.errstate(invalid='ignore'):
            same = np.abs(table - middle) <= TOLERANCE[0] + TOLERANCE[1] * middle
        seen = (middle <= FARTHEST) & (same.mean(axis=0) >= SAME)
        self.sectors = [_sector(run, middle) for run in _runs(seen)]


def _nearest(scan: Scan) -> NDArray[np.float64]:
    """Return the smallest range [m] in each of `SECTORS` sectors from the bearing 0 on; inf without a return."""
    nearest = np.full(SECTORS, np.inf)
    valid = scan.valid
    numbers = np.floor(scan.geometry.bearings[valid] * (SECTORS / (2.0 * math.pi))).astype(int) % SECTORS
    np.minimum.at(nearest, numbers, scan.ranges[valid])
    return nearest


def _runs(seen: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Return the numbers of each run of adjacent sectors that are `seen`; they may go past the last sector."""
    if seen.all():
        return [np.arange(len(seen))]
    start = int(np.flatnonzero(~seen)[0])
    numbers = start + np.flatnonzero(np.roll(seen, -start))
    return [run for run in np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1) if len(run)]


def _sector(run: NDArray[np.int64], middle: NDArray[np.float64]) -> BodySector:
    """Return the sector of a run, with the `MARGIN` at both ends."""
    step = 2.0 * math.pi / SECTORS
    first, last = step * int(run[0]), step * (int(run[-1]) + 1)
    return BodySector(first - MARGIN, last + MARGIN, float(middle[run % SECTORS].min()))


def described(sectors: Sequence[BodySector]) -> str:
    """Describe where a lidar sees the robot itself; the `sectors` are in its frame."""
    bearings = [f'from {math.degrees(first):.0f} to {math.degrees(last):.0f} deg at {distance:.2f} m'
                for first, last, distance in sectors]
    return f'sees the robot itself: {", ".join(bearings)}'


def advice(name: str, several: bool, given: Sequence[float], sectors: Sequence[BodySector]) -> str:
    """Return what to set the mask of a lidar to: the sectors `given` and found, as many as it can have.

    `name` is that of the lidar, empty if it has none; `several`: whether there are several lidars.
    """
    unnamed = 'its numbers in input.mask' if several else 'input.mask'
    mask = f'{name}.mask' if name else unnamed
    pairs = [(first, last) for first, last in zip(given[::2], given[1::2], strict=True) if first != last]
    pairs += [(round(each.first, 3), round(each.last, 3)) for each in sectors]
    values = list(itertools.chain(*pairs))[:2 * MOST]
    values += [0.0] * (2 * MOST - len(values))
    return f'set {mask} to {values}, which includes a margin of {math.degrees(MARGIN):.0f} deg at both ends'
