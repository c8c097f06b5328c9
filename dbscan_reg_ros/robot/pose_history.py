# SPDX-License-Identifier: Apache-2.0
"""Stamped history of poses, interpolated between the stamps."""
import bisect
import math

from ..core.geometry.se2 import SE2, wrap
from ..core.scan import SECOND

SPAN = 10 * SECOND
"""Duration [ns] for which poses are kept."""
LATE = SECOND
"""A pose that is older than the newest one by at most this [ns] is late, and is ignored; if it is older, time has gone
back."""


class PoseHistory:
    """Stores the planar poses of the last 10 s to 20 s, and interpolates between their stamps."""

    def __init__(self) -> None:
        self._stamps: list[int] = []
        self._poses: list[SE2] = []

    def reaches(self, stamp: int) -> bool:
        """Whether the history contains a pose at `stamp` [ns] or later."""
        return bool(self._stamps) and self._stamps[-1] >= stamp

    def add(self, stamp: int, pose: SE2) -> None:
        """Add the pose at `stamp` [ns].

        A repeated or late pose is ignored; when time has gone back, the history is cleared first.
        """
        if self._is_late(stamp):
            return
        if self._stamps and stamp < self._stamps[-1]:
            self.clear()
        self._stamps.append(stamp)
        self._poses.append(pose)
        if stamp - self._stamps[0] > 2 * SPAN:
            old = bisect.bisect_left(self._stamps, stamp - SPAN)
            del self._stamps[:old], self._poses[:old]

    def _is_late(self, stamp: int) -> bool:
        """Whether a pose at `stamp` [ns] is repeated or late: the newest stamp is equal or up to `LATE` newer."""
        return bool(self._stamps) and 0 <= self._stamps[-1] - stamp <= LATE

    def clear(self) -> None:
        """Remove all poses."""
        self._stamps.clear()
        self._poses.clear()

    def at(self, stamp: int) -> SE2 | None:
        """Return the pose interpolated at `stamp` [ns]; None before the first and after the last pose."""
        after = bisect.bisect_left(self._stamps, stamp)
        if after == len(self._stamps) or (after == 0 and self._stamps[0] != stamp):
            return None
        if self._stamps[after] == stamp:
            return self._poses[after]
        before = after - 1
        ratio = (stamp - self._stamps[before]) / (self._stamps[after] - self._stamps[before])
        return interpolate(self._poses[before], self._poses[after], ratio)

    def motion(self, start: int, end: int) -> SE2 | None:
        """Return the motion between two stamps [ns]; None if the pose at one of them is unknown."""
        first, last = self.at(start), self.at(end)
        return None if first is None or last is None else first.inverse() @ last


class HeadingHistory(PoseHistory):
    """History of headings, integrated from yaw rates; the positions are 0."""

    def __init__(self) -> None:
        super().__init__()
        self._rate = 0.0

    def add_rate(self, stamp: int, rate: float) -> None:
        """Integrate the yaw rate `rate` [rad/s] up to `stamp` [ns]; a non-finite, repeated or late rate is ignored."""
        if not math.isfinite(rate) or self._is_late(stamp):
            return
        heading = 0.0
        if self._stamps and stamp > self._stamps[-1]:
            heading = self._poses[-1].theta + 0.5 * (self._rate + rate) * (stamp - self._stamps[-1]) * 1e-9
        self._rate = rate
        self.add(stamp, SE2(0.0, 0.0, wrap(heading)))


def interpolate(before: SE2, after: SE2, ratio: float) -> SE2:
    """Interpolate between two poses along the shorter rotation: return `before` for `ratio` 0 and `after` for 1."""
    return SE2(before.x + ratio * (after.x - before.x), before.y + ratio * (after.y - before.y),
               wrap(before.theta + ratio * wrap(after.theta - before.theta)))
