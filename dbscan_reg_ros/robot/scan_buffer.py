# SPDX-License-Identifier: Apache-2.0
"""Scans of several lidars that wait to be processed, in the order of their stamps: from messages or from recordings."""
import heapq
import itertools
import math
from collections import deque
from collections.abc import Iterable, Iterator
from statistics import median
from typing import Generic, NamedTuple, TypeVar

from ..core.scan import Scan

T = TypeVar('T')


class ScanQueue(Generic[T]):
    """Scans of one lidar, in the order in which they came; `stamps` are theirs."""

    def __init__(self) -> None:
        self.stamps = RecentStamps()
        self._scans: deque[tuple[int, T]] = deque()

    def __len__(self) -> int:
        return len(self._scans)

    def add(self, stamp: int, scan: T) -> None:
        """Add a scan with a `stamp` [ns]."""
        self.stamps.add(stamp)
        self._scans.append((stamp, scan))

    @property
    def first_stamp(self) -> float:
        """Stamp [ns] of the scan that came first; infinite without any."""
        return self._scans[0][0] if self._scans else math.inf

    @property
    def first(self) -> T:
        """The scan that came first."""
        return self._scans[0][1]

    def pop(self) -> T:
        """Remove the scan that came first, and return it."""
        return self._scans.popleft()[1]

    def clear(self) -> None:
        """Drop all scans."""
        self._scans.clear()

    def has_older(self, stamp: int) -> bool:
        """Whether a scan with a stamp before `stamp` [ns] is there, or is due and has not come."""
        return self.first_stamp < stamp or self.stamps.expects_before(stamp)


class ScanBuffer(Generic[T]):
    """Queues of the scans of several lidars."""

    def __init__(self) -> None:
        self._queues: list[ScanQueue[T]] = []

    def add_queue(self) -> ScanQueue[T]:
        """Add the queue of one more lidar, and return it."""
        self._queues.append(ScanQueue())
        return self._queues[-1]

    def remove_queue(self, queue: ScanQueue[T]) -> None:
        """Remove a `queue`: scans of other lidars wait for none of its scans any more."""
        self._queues = [each for each in self._queues if each is not queue]

    def must_wait(self, queue: ScanQueue[T], stamp: int) -> bool:
        """Whether a scan of a `queue` with a `stamp` [ns] waits for an older one of another lidar."""
        return any(each.has_older(stamp) for each in self._queues if each is not queue)


class OfLidar(NamedTuple):
    """A scan of one of several lidars.

    `lidar` is the number of the lidar, from 0 for the first, and `own` that of the scan among the scans of this lidar.
    """

    lidar: int
    own: int
    scan: Scan


class RecordedScans:
    """Scans of the lidars of a recording, numbered from `first` on, in the order of their stamps.

    Where stamps of one lidar go back, its scans keep their order.
    """

    def __init__(self, streams: Iterable[Iterable[Scan]], first: int = 0) -> None:
        self._scans = heapq.merge(*(_numbered(lidar, scans) for lidar, scans in enumerate(streams, first)),
                                  key=lambda each: each.scan.stamp)
        self._next = next(self._scans, None)

    def before(self, stamp: float = math.inf) -> Iterator[OfLidar]:
        """Yield the scans before `stamp` [ns]: the oldest of the next ones, of equal stamps that of the first lidar."""
        while self._next and self._next.scan.stamp < stamp:
            yield self._next
            self._next = next(self._scans, None)


def _numbered(lidar: int, scans: Iterable[Scan]) -> Iterator[OfLidar]:
    return (OfLidar(lidar, own, scan) for own, scan in enumerate(scans))


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
