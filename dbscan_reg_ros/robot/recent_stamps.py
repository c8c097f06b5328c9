# SPDX-License-Identifier: Apache-2.0
"""Latest stamps of a lidar, from which its scan period is estimated."""
import itertools
from collections import deque
from statistics import median

MOST = 9
"""Number of stamps that are kept."""
HEARD = 3
"""A lidar is expected to send its next scan for this number of periods after its last one."""


class RecentStamps:
    """Latest stamps [ns] of one lidar, in the order in which its scans came."""

    def __init__(self) -> None:
        self._stamps: deque[int] = deque(maxlen=MOST)

    def add(self, stamp: int) -> None:
        """Add the stamp [ns] of the next scan."""
        self._stamps.append(stamp)

    def clear(self) -> None:
        """Forget all stamps."""
        self._stamps.clear()

    @property
    def period(self) -> float | None:
        """Median of the steps [ns] between the stamps; None before there are two."""
        steps = [later - stamp for stamp, later in itertools.pairwise(self._stamps)]
        return median(steps) if steps else None

    def is_heard(self, now: int, periods: float) -> bool:
        """Whether the last stamp is at most this number of periods before the stamp `now` [ns]."""
        period = self.period
        return period is not None and now - self._stamps[-1] <= periods * period

    def expects_before(self, stamp: int) -> bool:
        """Whether the next scan of this lidar is due before a `stamp` [ns] of another lidar, and has not come."""
        period = self.period
        return period is not None and self.is_heard(stamp, HEARD) and self._stamps[-1] + period < stamp
