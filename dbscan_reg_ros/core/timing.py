"""Intervals between scans, from stamps that jitter, repeat and jump."""
from collections import deque

import numpy as np

from .parameters import TimeParameters


class Intervals:
    """The time from scan to scan, cleaned by its running median."""

    def __init__(self):
        self._last = None
        self._recent = deque(maxlen=51)

    def next(self, stamp, parameters: TimeParameters):
        """Take the next stamp [ns].

        Returns
        -------
        interval : float
            Since the last stamp [s]; the running median where the stamps' own difference lies outside half to twice the
            median. 0 while nothing is known.
        jump : str
            What is wrong with the stamp when it lies more than `jump` away from the last; empty otherwise.
        """
        last, self._last = self._last, stamp
        if last is None:
            return 0.0, ''
        interval = (stamp - last) * 1e-9
        if interval < -parameters.jump:
            return self._median(), f'stamps went back by {-interval:.3f} s'
        if interval > parameters.jump:
            return self._median(), f'no scan for {interval:.3f} s'
        if interval > 0.0:
            self._recent.append(interval)
        median = self._median()
        return (interval if 0.5 * median <= interval <= 2.0 * median else median), ''

    def _median(self):
        return float(np.median(self._recent)) if self._recent else 0.0
