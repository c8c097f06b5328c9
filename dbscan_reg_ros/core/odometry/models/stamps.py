# SPDX-License-Identifier: Apache-2.0
"""Intervals between scans, from stamps that jitter, repeat and jump."""
from collections import deque
from dataclasses import dataclass
from enum import Enum
from statistics import median
from typing import NamedTuple

from ...parameters.odometry import TimeParameters


class Jump(Enum):
    """A jump of the stamps."""

    FORWARD = 'forward'
    BACKWARD = 'backward'


class ScanTiming(NamedTuple):
    """How long a scan takes.

    Attributes
    ----------
    duration : float [s]
        From its first beam to its last, by its `time_increment`; 0 for all beams at once.
    ratio : float
        Ratio of this that it may really take: clocks and drivers can be wrong by it.
    deskews : bool
        Whether the motion within the scan can be removed.
    """

    duration: float
    ratio: float
    deskews: bool

    def middle_offset(self, scan, features):
        """Time [s] from the stamp of a scan to the middle of its returns."""
        return middle_offset(scan, features, self.ratio) if self.duration else 0.0


@dataclass(frozen=True)
class ScanInterval:
    """The time from one scan to the next.

    Attributes
    ----------
    interval : float [s]
        The stamps' own difference where it can be believed, else the running median, or whole ones where scans would overlap; 0
        while nothing is known.
    elapsed : float [s]
        The stamps' own difference, 0 for stamps that go back.
    middle_offset : float [s]
        From the stamp of the scan to the middle of its beams.
    jump : Jump or None
        Whether the stamp lies more than `time.max_jump` away from the last, and to which side.
    reason : str
        The jump in words; empty without one.
    steady : bool
        The stamps tell when scans were taken: a long interval comes of scans that were lost.
    gap : bool
        So much time seems to have passed that the last motion says little of this one; or else the stamp is wrong.
    """

    interval: float = 0.0
    elapsed: float = 0.0
    middle_offset: float = 0.0
    jump: Jump | None = None
    reason: str = ''
    steady: bool = False

    @property
    def gap(self):
        return self.jump is not None or self.elapsed > _GAP * self.interval


# Stamps that jitter leave up to eight intervals between scans that are evenly apart, and then next to none.
_GAP = 10.0
# The share of a scan after which the next may seem to begin: stamps of a good clock jitter as well.
_OVER = 0.9
# No lidar is faster [s].
_LEAST = 0.001
# Where one scan is left out the stamps are two intervals apart, give or take what they jitter.
_TWICE = 2.05


class StampFilter:
    """The time from scan to scan, cleaned by its running median."""

    def __init__(self):
        self._last, self.duration = None, 0.0
        self._recent = deque(maxlen=51)

    def timing(self, scan, parameters) -> ScanTiming:
        """How long a `scan` takes; remembered as `duration`."""
        duration = abs(scan.time_increment) * scan.geometry.size if parameters.odometry.deskew else 0.0
        self.duration = duration if duration < parameters.time.max_jump else 0.0
        deskews = bool(self.duration) and not self.jumps(scan.stamp, parameters.time)
        return ScanTiming(self.duration, self.ratio(self.duration), deskews)

    def next(self, stamp, middle_offset, parameters: TimeParameters, lasts=0.0) -> ScanInterval:
        """Take the next scan's stamp [ns], the time from it to its middle [s], and how long it takes [s], 0 for all at once.

        No scan begins before the last is over: stamps that say so jitter, and what they say is rounded to whole intervals.
        """
        jumps, last, self._last = self.jumps(stamp, parameters), self._last, stamp
        if last is None:
            return ScanInterval(middle_offset=middle_offset)
        elapsed = (stamp - last) * 1e-9
        if jumps:
            jump = Jump.FORWARD if elapsed > 0.0 else Jump.BACKWARD
            reason = f'no scan for {elapsed:.3f} s' if jump is Jump.FORWARD else f'stamps went back by {-elapsed:.3f} s'
            return ScanInterval(self._median(), max(elapsed, 0.0), middle_offset, jump, reason)
        self._recent.append(elapsed)
        usual = self._median()
        steady = min(self._recent) > max(usual / _GAP, _OVER * lasts)
        if lasts and not steady:
            return ScanInterval(self._whole(elapsed, lasts), max(elapsed, 0.0), middle_offset)
        believed = steady or 0.5 * usual <= elapsed <= _TWICE * usual
        return ScanInterval(elapsed if believed else usual, max(elapsed, 0.0), middle_offset, steady=steady)

    def _whole(self, elapsed, lasts):
        """`elapsed` rounded to whole intervals, at least one: the median of those in which no scan seems to be lost."""
        recent = self._possible()
        if not recent:
            return 0.0
        usual = median(each for each in recent if each < 2.0 * max(recent[len(recent) // 4], lasts))
        return usual * max(round(elapsed / usual), 1)

    def jumps(self, stamp, parameters: TimeParameters) -> bool:
        """Whether a scan at `stamp` [ns] would lie more than `time.max_jump` away from the last."""
        return self._last is not None and abs(stamp - self._last) * 1e-9 > parameters.max_jump

    def ratio(self, lasts):
        """Ratio of its stated duration [s] that a scan may have taken: a clock or a driver can be wrong by that."""
        usual = self._median()
        return usual / lasts if 0.0 < usual < _OVER * lasts else 1.0

    def _median(self):
        recent = self._possible()
        return median(recent) if recent else 0.0

    def _possible(self):
        """The last intervals, in ascending order, without those that stamps which repeat or go back leave."""
        return sorted(elapsed for elapsed in self._recent if elapsed > _LEAST)


def middle_offset(scan, features, ratio):
    """Time [s] from the stamp of a scan to the middle of its returns, if it took a `ratio` of its stated duration."""
    return ratio * scan.time_increment * float(features.beams.mean())
