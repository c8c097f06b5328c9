# SPDX-License-Identifier: Apache-2.0
"""Properties of a whole CARMEN log that must be known to read its first scan."""
import math
from array import array
from typing import NamedTuple

import numpy as np

from ...core.geometry.se2 import SE2
from ..poses import corrected, relative
from ..stamps import mend

WIDTH = 0.001
"""Readings within this fraction of the greatest one form a group: a sensor has several codes, 81.83 to 81.91."""
FEWEST = 20
"""Fewest readings, within `WIDTH` of the greatest reading of a file, that can mean "no return"."""
BAND = 0.01
"""The greatest readings mean "no return" only if they are a peak, unlike the ranges of walls, which become rarer
towards the maximum: at most as many other readings may lie within this fraction of the greatest reading."""
JUMP = 0.1
"""Two adjacent readings that differ by more than this fraction lie on different surfaces, not on one wall."""
DIGITS = 5
"""Values with this many equal significant digits are counted as one, so that memory does not grow with the file."""


class NoReturn:
    """Find the range that encodes "no return" among the readings of scans, one scan at a time."""

    def __init__(self):
        self._greatest = 0.0
        self._values = {}

    def add(self, ranges, range_max=math.inf):
        """Add the readings ``(N,)`` [m] of a scan, in the order of the beams; ignore readings beyond `range_max`."""
        with np.errstate(invalid='ignore'):
            longest = range_max if range_max > 0.0 else math.inf
            usable = ranges[(ranges > 0.0) & np.isfinite(ranges) & ~(ranges > longest)]
        if not len(usable):
            return
        if (greatest := float(usable.max())) > self._greatest:
            self._greatest = greatest
            self._values = {value: found for value, found in self._values.items() if value >= (1.0 - BAND) * greatest}
        beams = np.flatnonzero(usable >= (1.0 - BAND) * self._greatest)
        if len(beams):
            self._count(usable, beams)

    def _count(self, usable, beams):
        values = usable[beams]
        padded = np.concatenate((usable[:1], usable, usable[-1:]))
        apart = np.abs(np.stack((padded[beams], padded[beams + 2])) - values) / values
        borders, jumps = (apart > WIDTH).sum(axis=0), (apart > JUMP).sum(axis=0)
        names, which = np.unique(values.round(DIGITS - 1 - math.floor(math.log10(self._greatest))), return_inverse=True)
        counts = (np.bincount(which, weights) for weights in (None, borders, jumps))
        for name, *found in zip(names.tolist(), *counts, strict=True):
            self._values[name] = [a + b for a, b in zip(self._values.get(name, (0, 0, 0)), found, strict=True)]

    def limit(self):
        """Return the smallest range [m] that means "no return"; None if the file has none.

        The greatest readings are accepted only if most of the readings of adjacent beams differ from them by more than
        `JUMP`: on a wall at the longest range, readings of adjacent beams are only a little shorter.
        """
        least = (1.0 - WIDTH) * self._greatest
        group = [found for value, found in self._values.items() if value >= least]
        readings, borders, jumps = (sum(column) for column in zip(*group, strict=True)) if group else (0, 0, 0)
        below = sum(found[0] for value, found in self._values.items() if value < least)
        return least if readings >= max(FEWEST, below) and 2 * jumps > borders else None


NOWHERE = (0.0, 0.0, 0.0)
SAME = 1e-6
"""Poses that differ by at most this [m, rad] are taken as the same pose, written twice."""
DETOUR, SLACK = 1.05, 0.01
"""A pose lies between two others if the motion via this pose is at most `DETOUR` times the direct motion plus
`SLACK`."""


class Survey:
    """Properties of all scans of one kind, gathered line by line."""

    def __init__(self):
        self.wheels = Wheels()
        self._stamps, self._laser, self._robot = [], array('d'), array('d')
        self._no_return = NoReturn()

    def add(self, line):
        """Add the data of one `Line`."""
        self._stamps.append(line.stamp)
        self._laser.extend(line.laser_pose or NOWHERE)
        self._robot.extend(line.robot_pose or NOWHERE)
        self._no_return.add(line.ranges[~line.missing], line.range_max)
        self.wheels.add_scan(line.stamp, line.robot_pose)

    def findings(self, filtered=False) -> 'Findings':
        """Return the properties of the whole log; `filtered` states whether it contains lines of a particle filter."""
        stamps, stamp_note = mend(self._stamps)
        no_return = self._no_return.limit()
        range_note = '' if no_return is None else (f'readings of {no_return:.3f} m or more are used as no return: the '
                                                   'greatest value of the log is frequent and isolated')
        poses, mounting = self._poses(filtered), self._mounting()
        notes = [note for note in (stamp_note, range_note, poses.note) if note]
        return Findings(stamps, poses.laser, poses.robot, poses.corrected, no_return, notes, mounting)

    def _mounting(self) -> SE2 | None:
        """Return the constant pose of the laser on the robot, or None: without one, programs write both poses equal."""
        laser, robot = self._recorded()
        if not len(robot) or corrected(laser, robot) or np.abs(laser[0] - robot[0]).max() <= SAME:
            return None
        return SE2(*relative(robot[:1], laser[:1])[0].tolist())

    def _recorded(self):
        """Return the poses of laser and robot in the lines, both ``(N, 3)``."""
        return (np.array(poses).reshape(-1, 3) for poses in (self._laser, self._robot))

    def _poses(self, filtered) -> 'Poses':
        laser, robot = self._recorded()
        is_corrected, wheels = bool(len(robot)) and corrected(laser, robot), self.wheels.poses()
        if not robot.any():
            if wheels is not None:
                robot, laser = wheels, laser if laser.any() else wheels
        elif not is_corrected and self.wheels.contradict():
            return Poses(laser, wheels, True, 'the poses of the scans differ from the ODOM lines: they are used as '
                         'ground truth, the ODOM lines as wheel odometry')
        elif not is_corrected and filtered:
            return Poses(laser, np.zeros_like(robot), True, 'the poses of the scans come from a particle filter (NEFF '
                         'lines): they are used as ground truth; the log contains no wheel odometry')
        return Poses(laser, robot, is_corrected)


class Poses(NamedTuple):
    """Poses ``(N, 3)`` [m, m, rad] of laser and robot, as in `Findings`; `note` states what was assumed about them."""

    laser: np.ndarray
    robot: np.ndarray
    corrected: bool
    note: str = ''


class Findings(NamedTuple):
    """Properties of the scans of a whole log."""

    stamps: list
    """list of int (N,) [ns]: corrected stamps from `stamps.mend`."""
    laser: np.ndarray
    robot: np.ndarray
    """Poses of the laser, and poses of the robot from wheel odometry ``(N, 3)`` [m, m, rad]."""
    corrected: bool
    """Whether the laser's poses are the ground truth."""
    no_return: float | None
    """Smallest range that means "no return", from `NoReturn.limit` [m]."""
    notes: list[str]
    """Assumptions that were made."""
    mounting: SE2 | None = None
    """Pose of the laser on the robot, if its offset in the poses of the lines is constant and not zero."""


class Wheels:
    """Wheel odometry of the ``ODOM`` lines, interpolated at the scans between them.

    In a log that was corrected afterwards, an ``ODOM`` line repeats the corrected pose of the scan before it, and the
    next ``ODOM`` lines continue from that pose. The pieces of wheel odometry between such repetitions are joined to one
    trajectory.
    """

    def __init__(self):
        self._pose = (0.0, 0.0, 0.0)
        self._last = None
        self._scans = array('d')
        self._open = []
        self._lines = 0
        self._different = 0

    def add_scan(self, stamp, pose):
        """Add a scan with its stamp [ns] and the robot's pose ``(x, y, theta)`` [m, m, rad], or None."""
        self._open.append((len(self._scans) // 3, stamp, pose, self._lines))
        self._scans.extend(self._pose)
        self._lines = 0

    def add_odometry(self, stamp, pose):
        """Add an ``ODOM`` line with its stamp [ns] and pose ``(x, y, theta)`` [m, m, rad]."""
        if self._last is None:
            self._pose = pose
            for index, *_ in self._open:
                self._set(index, pose)
        elif self._repeats(pose):
            for _, at, robot, lines in self._open:
                # The first line since the scan before repeated that scan's pose; only further ones are wheel odometry.
                if robot:
                    self._different += lines > 1 and (at == self._last[0] or stamp < self._last[0])
        else:
            self._advance(stamp, pose)
        self._open.clear()
        self._last = stamp, pose
        self._lines += 1

    def poses(self):
        """Return the poses ``(N, 3)`` of the wheels at the scans [m, m, rad]; None if there is no ``ODOM`` line."""
        return None if self._last is None else np.array(self._scans).reshape(-1, 3)

    def contradict(self) -> bool:
        """Whether the poses of at least half of the scans differ from the ``ODOM`` lines."""
        return 2 * self._different >= max(len(self._scans) // 3 - 1, 1)

    def _repeats(self, pose):
        """Whether the `pose` of an ``ODOM`` line is that of the last scan, and not that of the last ``ODOM`` line."""
        robot = self._open[-1][2] if self._open else None
        return robot is not None and _same(robot, pose) and not _same(self._last[1], pose)

    def _advance(self, stamp, pose):
        """Move the wheels to `pose` at `stamp` [ns]; interpolate the poses of scans since the last ``ODOM`` line."""
        (before, last), step = self._last, _step(self._last[1], pose)
        for index, at, robot, _ in self._open:
            if robot:
                self._different += _is_detour(last, robot, pose)
            if before < at <= stamp:
                self._set(index, self._after(step, (at - before) / (stamp - before)))
        self._pose = self._after(step)

    def _after(self, step, share=1.0):
        pose = SE2(*self._pose) @ SE2(*(share * value for value in step))
        return pose.x, pose.y, pose.theta

    def _set(self, index, pose):
        self._scans[3 * index:3 * index + 3] = array('d', pose)


def _step(a, b):
    """Return the pose `b` in the frame of the pose `a`."""
    pose = SE2(*a).inverse() @ SE2(*b)
    return pose.x, pose.y, pose.theta


def _is_detour(start, pose, end):
    """Whether the detour from `start` over `pose` to `end` exceeds the limits `DETOUR` and `SLACK`."""
    there, on, whole = ((math.hypot(x, y), abs(theta)) for x, y, theta in (_step(start, pose), _step(pose, end),
                                                                           _step(start, end)))
    return any(a + b > DETOUR * c + SLACK for a, b, c in zip(there, on, whole, strict=True))


def _same(a, b):
    return max(abs(p - q) for p, q in zip(a, b, strict=True)) <= SAME
