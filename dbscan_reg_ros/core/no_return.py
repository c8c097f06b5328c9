# SPDX-License-Identifier: Apache-2.0
"""Detection of the range that a driver sends in place of a missing return."""
import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .repeated_ranges import with_repeated_end
from .scan import Scan


class _Shared(NamedTuple):
    """The largest range [m] that several beams of a scan share exactly.

    `impossible` is whether no surface in front of the sensor can give this range to that many beams.
    """

    value: float
    impossible: bool


@dataclass
class _Evidence:
    """Evidence that a shared value is no return.

    Attributes
    ----------
    scans, changed : int
        Number of scans with this value, and of those in which the other ranges had changed.
    used : bool
        Whether the value is treated as no return.
    """

    scans: int = 0
    changed: int = 0
    used: bool = False


class NoReturn:
    """Finds, scan by scan, ranges that mean "no return".

    A surface can share one exact range among a few beams only: those near its nearest point, within the resolution of
    the ranges. A smooth surface puts at most 1 / (sqrt(2) - 1) = 2.4 times as many beams into the last step of the
    resolution as into the one before. A largest range that more beams share is no return; so is one that stays the same
    while the other ranges change.

    Attributes
    ----------
    known : float or None
        Largest range that is known to mean "no return" [m].
    """

    def __init__(self) -> None:
        self.known: float | None = None
        self._evidence: dict[float, _Evidence] = {}
        self._last = np.empty(0, dtype=np.float32)

    def add(self, ranges: npt.ArrayLike, range_max: float, angle_increment: float) -> list[float]:
        """Add a scan.

        Parameters
        ----------
        ranges : (N,) float [m]
        range_max : float [m]
            Largest range that the driver states; not positive or not finite: no limit.
        angle_increment : float [rad]

        Returns
        -------
        list of float
            Ranges that are to be used as no return in this scan [m].
        """
        ranges, last = np.asarray(ranges, dtype=np.float32), self._last
        self._last = ranges
        if shared := _shared(ranges, range_max if range_max > 0.0 else math.inf, angle_increment):
            self._weigh(shared, _has_changed(last, ranges, shared))
        return [value for value, each in self._evidence.items() if each.used]

    def removed_from(self, scan: Scan) -> Scan:
        """Add a scan; return it without the beams whose range means "no return"."""
        geometry = scan.geometry
        codes = [code for code in self.add(scan.ranges, geometry.range_max, geometry.angle_increment)
                 if code < geometry.range_max]
        if not codes:
            return scan
        ranges = np.where(np.isin(scan.ranges, np.array(codes, dtype=np.float32)), np.float32(np.inf), scan.ranges)
        return Scan(scan.stamp, ranges, geometry, scan.time_increment, scan.frame_id)

    def _weigh(self, shared: _Shared, has_changed: bool) -> None:
        if len(self._evidence) >= _MOST_VALUES and shared.value not in self._evidence:
            self._evidence = {value: each for value, each in self._evidence.items() if each.changed >= _MANY}
        first = not self._evidence
        each = self._evidence.setdefault(shared.value, _Evidence())
        each.scans += 1
        each.changed += has_changed
        each.used = each.used or each.changed >= _MANY or (shared.impossible and (first or each.scans > 1))
        if each.changed >= _MANY:
            self.known = max(shared.value, self.known or 0.0)


def _has_changed(last: npt.NDArray[np.float32], ranges: npt.NDArray[np.float32], shared: _Shared) -> bool:
    """Whether enough of the ranges that are not `shared` differ from those of the last scan, by motion or by noise."""
    if len(last) != len(ranges):
        return len(last) > 0
    value = np.float32(shared.value)
    others = np.isfinite(ranges) & (ranges != value) & (last != value)
    equal = _EQUAL_IMPOSSIBLE if shared.impossible else _EQUAL
    return bool(np.count_nonzero(ranges[others] == last[others]) <= equal * np.count_nonzero(others))


def _shared(ranges: npt.NDArray[np.float32], range_max: float, angle_increment: float) -> _Shared | None:
    """Return the largest range that at least `_FEWEST` beams share, but for a few stray ones; None if chance may do it.

    The allowed number of beams follows from the other ranges of the scan: the most beams that share another large
    range, and the resolution, which for triangulating sensors grows with the square of the range.
    """
    values = with_repeated_end(ranges, range_max, _FEWEST, _STRAY)
    if values is None:
        return None
    distinct, counts = np.unique(values, return_counts=True)
    beyond = len(values) - np.cumsum(counts)
    shared = np.flatnonzero((counts >= _FEWEST) & (beyond <= _STRAY * counts))
    if not len(shared):
        return None
    last = shared[-1]
    value, count = float(distinct[last]), int(counts[last])
    others, counts = np.delete(distinct, last), np.delete(counts, last)
    if len(others) < _FEWEST_OTHERS:
        return None
    if count < _RATIO * counts[others >= 0.5 * value].max(initial=1):
        return None
    far = others[others >= 0.5 * others[-_FEWEST_OTHERS]]
    resolution = float(np.quantile(np.diff(far) * (value / far[1:])**2, 0.1))
    width = math.sqrt(8.0 * resolution / value)
    return _Shared(value, count * abs(angle_increment) >= _RATIO * width)


_FEWEST = 5
"""Fewest beams that share a range that can mean "no return"."""
_FEWEST_OTHERS = 8
"""Fewest different other ranges from which the resolution is estimated."""
_STRAY = 0.05
"""Largest number of ranges beyond the shared one, as a fraction of the beams that share it."""
_RATIO = 4
"""A value is judged if it is shared by this many times as many beams as any other large range; a surface shares at most
2.4 times as many."""
_MANY = 5
"""Number of scans that must share a value, while their other ranges change, before it is known to mean "no return"."""
_EQUAL, _EQUAL_IMPOSSIBLE = 0.4, 0.9
"""The other ranges have changed if at most this fraction is exactly as in the last scan; the second one is for a value
that no surface can give, as without noise the ranges to a wall alongside stay the same."""
_MOST_VALUES = 16
"""Largest number of values that are remembered."""
