# SPDX-License-Identifier: Apache-2.0
"""Detection of the range that a file contains in place of a missing return."""
import math

import numpy as np

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
