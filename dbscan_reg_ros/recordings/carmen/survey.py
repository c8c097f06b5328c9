# SPDX-License-Identifier: Apache-2.0
"""What has to be known of a whole CARMEN log before its first scan can be given."""
import math
from array import array
from typing import NamedTuple

import numpy as np

from ...core.geometry.se2 import SE2
from ..poses import corrected
from ..stamps import mend
from .no_return import NoReturn

NOWHERE = (0.0, 0.0, 0.0)
SAME = 1e-6
"""Poses that differ by no more are one and the same, written twice [m, rad]."""
SLACK = 0.01
"""A pose between two others may be so far off the straight way [m, rad], besides a twentieth of that way."""


class Survey:
    """Properties of all scans of one kind, gathered line by line."""

    def __init__(self):
        self.wheels = Wheels()
        self._stamps, self._laser, self._robot = [], array('d'), array('d')
        self._no_return = NoReturn()

    def add(self, line):
        """Take in a `Line`."""
        self._stamps.append(line.stamp)
        self._laser.extend(line.laser_pose or NOWHERE)
        self._robot.extend(line.robot_pose or NOWHERE)
        self._no_return.add(line.ranges, line.range_max)
        self.wheels.add_scan(line.stamp, line.robot_pose)

    def findings(self, filtered=False) -> 'Findings':
        """Return what holds for the scans of the whole log; `filtered` where it holds lines of a particle filter."""
        notes = []
        stamps, note = mend(self._stamps)
        if note:
            notes.append(note)
        no_return = self._no_return.limit()
        if no_return is not None:
            notes.append(f'readings of {no_return:.3f} m or more are taken for no return: the greatest value of the '
                         'log stands alone and often')
        laser, robot = (np.array(poses).reshape(-1, 3) for poses in (self._laser, self._robot))
        is_corrected, wheels = bool(len(robot)) and corrected(laser, robot), self.wheels.poses()
        if not is_corrected and robot.any() and self.wheels.contradict():
            is_corrected, robot = True, wheels
            notes.append('the poses of the scans differ from the ODOM lines: they are taken for the truth, the ODOM '
                         'lines for the wheel odometry')
        elif not is_corrected and filtered and robot.any():
            is_corrected, robot = True, np.zeros_like(robot)
            notes.append('the poses of the scans come from a particle filter (NEFF lines): they are taken for the '
                         'truth; the log holds no wheel odometry')
        elif wheels is not None and not robot.any():
            robot, laser = wheels, laser if laser.any() else wheels
        return Findings(stamps, laser, robot, is_corrected, no_return, notes)


class Findings(NamedTuple):
    """What holds for the scans of a log.

    Attributes
    ----------
    stamps : list of int (N,) [ns]
        As from `stamps.mend`.
    laser, robot : (N, 3) float [m, m, rad]
        Poses; those of the robot are the wheels'.
    corrected : bool
        The laser's poses are the truth.
    no_return : float [m] or None
        As from `NoReturn.limit`.
    notes : list of str
        What was assumed.
    """

    stamps: list
    laser: np.ndarray
    robot: np.ndarray
    corrected: bool
    no_return: float | None
    notes: list


class Wheels:
    """The wheel odometry that the ``ODOM`` lines tell, at the scans between them.

    In a log that was corrected afterwards an ``ODOM`` line repeats the corrected pose of the scan before it, and the
    next ones go on from there. The way of the wheels is put together from the pieces.
    """

    def __init__(self):
        self._way = (0.0, 0.0, 0.0)
        self._last = None
        self._scans = array('d')
        self._open = []
        self._lines = 0
        self._different = 0

    def add_scan(self, stamp, pose):
        """Add a scan with its stamp [ns] and the robot's pose ``(x, y, theta)`` [m, m, rad], or None."""
        self._open.append((len(self._scans) // 3, stamp, pose, self._lines))
        self._scans.extend(self._way)
        self._lines = 0

    def add_odometry(self, stamp, pose):
        """Add an ``ODOM`` line with its stamp [ns] and pose ``(x, y, theta)`` [m, m, rad]."""
        if self._last is None:
            self._way = pose
            for index, *_ in self._open:
                self._set(index, pose)
        else:
            before, last = self._last
            step, told = _step(last, pose), self._open[-1][2] if self._open else None
            repeats = told is not None and _same(told, pose) and not _same(last, pose)
            for index, at, scan, lines in self._open:
                if scan:
                    self._decide(scan, last, pose, lines if repeats else None, at == before or stamp < before)
                if before < at <= stamp and not repeats:
                    self._set(index, self._after(step, (at - before) / (stamp - before)))
            if not repeats:
                self._way = self._after(step)
        self._open.clear()
        self._last = stamp, pose
        self._lines += 1

    def poses(self):
        """``(N, 3)`` poses of the wheels at the scans [m, m, rad]; None where there is no ``ODOM`` line."""
        return None if self._last is None else np.array(self._scans).reshape(-1, 3)

    def contradict(self) -> bool:
        """Whether the poses of half of the scans, or more, are others than the ``ODOM`` lines tell."""
        return 2 * self._different >= max(len(self._scans) // 3 - 1, 1)

    def _decide(self, scan, last, pose, lines, one_moment):
        """Whether a scan's pose differs from that of the wheels, which were at `last` before it and at `pose` after it.

        Where `pose` repeats the scan's, `lines` says how many lines came since the scan before it: the first of them
        repeated that one, only more tell of the wheels; and `one_moment` whether scan and last line belong to one
        moment.
        """
        if lines is not None:
            self._different += lines > 1 and one_moment
            return
        there, on, whole = ((math.hypot(x, y), abs(turn)) for x, y, turn in (_step(last, scan), _step(scan, pose),
                                                                             _step(last, pose)))
        self._different += any(a + b > 1.05 * c + SLACK for a, b, c in zip(there, on, whole, strict=True))

    def _after(self, step, share=1.0):
        pose = SE2(*self._way) @ SE2(*(share * value for value in step))
        return pose.x, pose.y, pose.theta

    def _set(self, index, pose):
        self._scans[3 * index:3 * index + 3] = array('d', pose)


def _step(a, b):
    """Return the pose `b` in the frame of the pose `a`."""
    pose = SE2(*a).inverse() @ SE2(*b)
    return pose.x, pose.y, pose.theta


def _same(a, b):
    return max(abs(p - q) for p, q in zip(a, b, strict=True)) <= SAME
