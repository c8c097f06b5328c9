# SPDX-License-Identifier: Apache-2.0
"""Intervals between scans, from stamps that jitter, repeat and jump."""
from collections import deque
from dataclasses import dataclass
from statistics import median

from ...parameters.odometry import TimeParameters


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
    half : float [s]
        From the stamp of the scan to the middle of its beams.
    jump : str
        What is wrong with the stamp when it lies more than `time.max_jump` away from the last; empty otherwise.
    steady : bool
        The stamps tell when scans were taken: a long interval comes of scans that were lost.
    gap : bool
        So much time seems to have passed that the last motion says little of this one; or else the stamp is wrong.
    """

    interval: float = 0.0
    elapsed: float = 0.0
    half: float = 0.0
    jump: str = ''
    steady: bool = False

    @property
    def gap(self):
        return bool(self.jump) or self.elapsed > _GAP * self.interval


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
        self._last = None
        self._recent = deque(maxlen=51)

    def next(self, stamp, half, parameters: TimeParameters, lasts=0.0) -> ScanInterval:
        """Take the next scan's stamp [ns], the time from it to its middle [s], and how long it takes [s], 0 for all at once.

        No scan begins before the last is over: stamps that say so jitter, and what they say is rounded to whole intervals.
        """
        jumps, last, self._last = self.jumps(stamp, parameters), self._last, stamp
        if last is None:
            return ScanInterval(half=half)
        elapsed = (stamp - last) * 1e-9
        if jumps:
            reason = f'no scan for {elapsed:.3f} s' if elapsed > 0.0 else f'stamps went back by {-elapsed:.3f} s'
            return ScanInterval(self._median(), max(elapsed, 0.0), half, reason)
        self._recent.append(elapsed)
        usual = self._median()
        steady = min(self._recent) > max(usual / _GAP, _OVER * lasts)
        if lasts and not steady:
            return ScanInterval(self._whole(elapsed, lasts), max(elapsed, 0.0), half)
        believed = steady or 0.5 * usual <= elapsed <= _TWICE * usual
        return ScanInterval(elapsed if believed else usual, max(elapsed, 0.0), half, steady=steady)

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

    def share(self, lasts):
        """The share of the time it is said to take [s] that a scan may have taken: a clock or a driver can be wrong by that."""
        usual = self._median()
        return usual / lasts if 0.0 < usual < _OVER * lasts else 1.0

    def _median(self):
        recent = self._possible()
        return median(recent) if recent else 0.0

    def _possible(self):
        """The last intervals, in ascending order, without those that stamps which repeat or go back leave."""
        return sorted(elapsed for elapsed in self._recent if elapsed > _LEAST)
