# SPDX-License-Identifier: Apache-2.0
"""Whether the stamps of a further lidar are those of the clock of the first lidar."""
from ...scan import SECOND


class ClockCheck:
    """Compares the stamps of two lidars in the order in which their scans arrive.

    Attributes
    ----------
    apart : float [s]
        By how much the clock of the further lidar is ahead; 0 if the stamps agree, or if the first lidar is silent.
    """

    def __init__(self) -> None:
        self.apart = 0.0
        self._first: int | None = None
        self._further: int | None = None
        self._agreed, self._count = False, 0

    def add_first(self, stamp: int) -> None:
        """Add the `stamp` [ns] of a scan of the first lidar."""
        self._first, self._count = stamp, 0
        if self._further is not None and self._further - stamp > _APART:
            self.apart = (self._further - stamp) / SECOND

    def add_further(self, stamp: int) -> None:
        """Add the `stamp` [ns] of a scan of the further lidar."""
        self._further = stamp
        self._count += 1
        if self._first is None:
            return
        difference = stamp - self._first
        if abs(difference) <= _APART:
            self.apart, self._agreed = 0.0, True
        elif difference < 0 or not (self._agreed or self._count > _SILENT):
            self.apart = difference / SECOND
        elif self._count > _SILENT:
            self.apart = 0.0


_APART = 250_000_000
"""Stamps of one clock differ by less than this time [ns]: slow lidars send a scan so long after its first beam."""
_SILENT = 10
"""The first lidar counts as silent after this number of scans of the further one."""
