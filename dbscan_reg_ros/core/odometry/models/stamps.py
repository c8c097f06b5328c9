# SPDX-License-Identifier: Apache-2.0
"""Intervals between scans, from stamps that jitter, repeat and jump."""
import math
from bisect import bisect_left, insort
from collections import deque
from collections.abc import Sequence
from enum import Enum
from statistics import median
from typing import NamedTuple

import numpy as np

from ...features.records import Features
from ...geometry.se2 import DOF, SE2
from ...geometry.tolerance import TINY
from ...parameters.odometry import TimeParameters
from ...parameters.tree import Parameters
from ...scan import SECOND, Scan


class Jump(Enum):
    """Direction of a jump of the stamps."""

    FORWARD = 'forward'
    BACKWARD = 'backward'


class ScanTiming(NamedTuple):
    """How long a scan takes.

    Attributes
    ----------
    duration : float [s]
        Time from the first beam to the last according to `Scan.time_increment`; 0 if all beams are measured at once.
    ratio : float
        Ratio of the estimated true duration to `duration`, at most 1: drivers may report a wrong `time_increment`.
    deskews : bool
        Whether the motion within the scan can be removed.
    """

    duration: float
    ratio: float
    deskews: bool

    def middle_offset(self, scan: Scan, features: Features) -> float:
        """Return the time [s] from the stamp of a scan to the middle of its returns."""
        return middle_offset(scan, features, self.ratio) if self.duration else 0.0


class ScanInterval(NamedTuple):
    """The time from one scan to the next.

    Attributes
    ----------
    length : float [s]
        Difference of the stamps if it is plausible; otherwise the running median, or a whole multiple of the median if
        scans would overlap. 0 while unknown.
    elapsed : float [s]
        Difference of the stamps; 0 if the stamps went back.
    middle_offset : float [s]
        Time from the stamp of the scan to the middle of its beams.
    jump : Jump or None
        Direction of a jump of the stamps by more than `time.max_jump`.
    reason : str
        Description of the jump; empty without a jump.
    missing : bool
        Whether scans are missing: the stamps jumped forward, and the interval is far longer than the usual one.
    steady : bool
        Whether the stamps are regular, so that a long interval means dropped scans.
    of_others : bool
        Whether the last scan was of another sensor, so that successive intervals may differ in length.
    sigma : float [s]
        Standard deviation of `length`: the stamps may jitter, or be right and scans were dropped.
    """

    length: float
    elapsed: float
    middle_offset: float
    jump: Jump | None = None
    reason: str = ''
    missing: bool = False
    steady: bool = False
    of_others: bool = False
    sigma: float = 0.0

    @property
    def gap(self) -> bool:
        """Whether the last velocity cannot predict the motion: scans are missing for long, or the stamp is wrong."""
        return self.jump is not None or self.elapsed > _GAP_RATIO * abs(self.length)

    def measures_velocity(self, time: float) -> bool:
        """Whether a velocity can be computed from the last scan of the same sensor, which is `time` [s] old."""
        known = time > 0.0 if self.of_others else self.length > 0.0 and self.elapsed > 0.0
        return known and not self.gap


class StampFilter:
    """Running median of the intervals between stamps.

    Attributes
    ----------
    duration : float [s]
        Duration of the last scan, as in `ScanTiming`.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self.duration = 0.0
        self._recent: deque[float] = deque(maxlen=_MEDIAN_SIZE)
        # The recent intervals in ascending order, without those of stamps that repeat or go back.
        self._positive: list[float] = []
        self._between: deque[float] = deque(maxlen=_MEDIAN_SIZE)
        # By the stamps, and by regular intervals: time since `judge`, velocities, and their squared changes.
        self._middle: SE2 | None = None
        self._since_judged, self._velocities, self._changes = np.zeros(2), np.zeros((2, DOF)), np.zeros(2)

    def timing(self, scan: Scan, parameters: Parameters, since_last: float) -> ScanTiming:
        """Return how long a `scan` takes, and store its duration as `duration`.

        The velocity that deskews it is known after a jump of the own stamps, too, if the time `since_last` [s] from the
        last scan of any sensor is at most `time.max_jump`.
        """
        duration = scan.duration if parameters.odometry.deskew else 0.0
        self.duration = duration if duration < parameters.time.max_jump else 0.0
        outdated = self.jumps(scan.stamp, parameters.time) and abs(since_last) > parameters.time.max_jump
        deskews = bool(self.duration) and not outdated
        return ScanTiming(self.duration, self.ratio(self.duration), deskews)

    def next(self, stamp: int, middle_offset: float, parameters: TimeParameters,
             scan_duration: float) -> ScanInterval:
        """Add a stamp and determine the interval since the last one.

        A scan cannot begin before the previous one ends. If the stamps contradict this, they jitter: intervals are
        rounded to whole multiples of the median.

        Parameters
        ----------
        stamp : int [ns]
        middle_offset : float [s]
            Time from the stamp to the middle of the scan.
        parameters : TimeParameters
        scan_duration : float [s]
            Time from the first beam to the last; 0 if all beams are measured at once.
        """
        jumps, last, self._last = self.jumps(stamp, parameters), self._last, stamp
        if last is None:
            return ScanInterval(0.0, 0.0, middle_offset)
        elapsed = seconds(stamp - last)
        usual = median(self._between) if jumps and self._between else parameters.max_jump
        self._between.append(elapsed)
        if jumps:
            self._middle = None
            jump = Jump.FORWARD if elapsed > 0.0 else Jump.BACKWARD
            reason = f'no scan for {elapsed:.3f} s' if jump is Jump.FORWARD else f'stamps went back by {-elapsed:.3f} s'
            missing = elapsed > _GAP_RATIO * usual
            return ScanInterval(self.typical, max(elapsed, 0.0), middle_offset, jump, reason, missing)
        self._add(elapsed)
        regular = self._regular(elapsed, scan_duration)
        self._since_judged += elapsed, regular
        steady = (min(self._recent) > max(self.typical / _GAP_RATIO, _OVERLAP_RATIO * scan_duration)
                  or (elapsed > 0.0 and self._changes[0] < self._changes[1]))
        length, sigma = elapsed if steady else regular, abs(elapsed - regular) * self._doubt
        return ScanInterval(length, max(elapsed, 0.0), middle_offset, steady=steady, sigma=sigma)

    def _add(self, elapsed: float) -> None:
        """Add an interval [s] to the recent ones, in place of the oldest."""
        oldest = self._recent[0] if len(self._recent) == _MEDIAN_SIZE else 0.0
        if oldest > _MIN_INTERVAL:
            del self._positive[bisect_left(self._positive, oldest)]
        self._recent.append(elapsed)
        if elapsed > _MIN_INTERVAL:
            insort(self._positive, elapsed)

    def judge(self, middle: SE2) -> None:
        """Compare the velocities by the stamps with those by regular intervals, at the `middle` of a found scan.

        Scans that were dropped leave exact stamps at uneven intervals, stamps that jitter leave even intervals at
        inexact stamps. By the right intervals the velocity changes less.
        """
        if self._middle is not None:
            motion = (self._middle.inverse() @ middle).as_array()
            if abs(motion).max() < _LEAST_MOTION:
                return
            velocities = motion / np.maximum(self._since_judged, _MIN_INTERVAL)[:, None]
            self._changes = _KEPT * self._changes + ((velocities - self._velocities) ** 2).sum(axis=1)
            self._velocities = velocities
        self._middle, self._since_judged = middle, np.zeros(2)

    @property
    def _doubt(self) -> float:
        """Standard deviation of the choice between both intervals: at most 0.5."""
        by_stamps, regular = (self._changes + TINY).tolist()
        return 1.0 / math.hypot(by_stamps / regular, regular / by_stamps, math.sqrt(2.0))

    def _regular(self, elapsed: float, scan_duration: float) -> float:
        """Return the interval [s] if stamps jitter: `elapsed` [s] only where it is near the median."""
        if scan_duration:
            return self._rounded(elapsed, scan_duration)
        typical = self.typical
        return elapsed if 0.5 * typical <= elapsed <= _MAX_RATIO * typical else typical

    def _rounded(self, elapsed: float, scan_duration: float) -> float:
        """Round `elapsed` [s] to a whole multiple (at least 1) of the median interval between successive scans."""
        recent = self._positive
        if not recent:
            return 0.0
        limit = 2.0 * max(recent[len(recent) // 4], scan_duration)
        typical = _median(recent, bisect_left(recent, limit))
        return typical * max(round(elapsed / typical), 1)

    def jumps(self, stamp: int, parameters: TimeParameters) -> bool:
        """Whether a `stamp` [ns] differs from the last one by more than `time.max_jump`."""
        return self._last is not None and seconds(abs(stamp - self._last)) > parameters.max_jump

    def ratio(self, scan_duration: float) -> float:
        """Return the ratio, at most 1, by which to reduce `scan_duration` [s] so that it fits the median interval."""
        if scan_duration <= 0.0:
            return 1.0
        typical = self.typical
        return typical / scan_duration if 0.0 < typical < _OVERLAP_RATIO * scan_duration else 1.0

    @property
    def typical(self) -> float:
        """The median interval [s]; 0 while none is known."""
        return _median(self._positive, len(self._positive))


def middle_offset(scan: Scan, features: Features, ratio: float) -> float:
    """Return the time [s] from the stamp to the middle of the returns, with the scan's duration times `ratio`."""
    return ratio * scan.time_increment * float(features.beams.mean())


def _median(ascending: Sequence[float], count: int) -> float:
    """Return the median of the first `count` of numbers in ascending order; 0 if there are none."""
    middle = count // 2
    if count % 2 or not count:
        return ascending[middle] if count else 0.0
    return (ascending[middle - 1] + ascending[middle]) / 2


def seconds(nanoseconds: int) -> float:
    """Return a difference of stamps [ns] in seconds."""
    return nanoseconds * (1.0 / SECOND)


_MEDIAN_SIZE = 51
"""Number of intervals in the running median."""
_GAP_RATIO = 10.0
"""An interval longer than this multiple of the median is a gap; jitter alone may reach eight times the median."""
_OVERLAP_RATIO = 0.9
"""A scan overlaps the next one if the interval is below this ratio of its duration; below 1 for jitter of stamps."""
_MIN_INTERVAL = 0.001
"""Intervals shorter than this [s] are ignored: no lidar is that fast."""
_MAX_RATIO = 2.05
"""An interval up to this multiple of the median is plausible: it allows for one dropped scan and jitter."""
_LEAST_MOTION = 0.02
"""Motion [m, rad] from which on a velocity is compared: less of it is noise."""
_KEPT = 0.9
"""Fraction of the squared changes of the velocity that is kept from one comparison to the next."""
