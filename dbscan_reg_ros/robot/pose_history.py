# SPDX-License-Identifier: Apache-2.0
"""Poses at any moment, interpolated between those that were told."""
import bisect
import math

from ..core.geometry.se2 import SE2, wrap

SPAN = 10_000_000_000
"""So much of the past is kept [ns]."""
LATE = 1_000_000_000
"""What lies farther back [ns] than the newest was not overtaken: time has gone back."""


class PoseHistory:
    """The planar poses of the last seconds."""

    def __init__(self):
        self._stamps = []
        self._poses = []

    def reaches(self, stamp) -> bool:
        """Whether there is a pose at `stamp` [ns] or later."""
        return bool(self._stamps) and self._stamps[-1] >= stamp

    def add(self, stamp, pose: SE2):
        """Keep the pose at `stamp` [ns]; one that comes twice or late is passed over, time that goes back empties the
        history first."""
        if self._is_late(stamp):
            return
        if self._stamps and stamp < self._stamps[-1]:
            self.clear()
        self._stamps.append(stamp)
        self._poses.append(pose)
        if stamp - self._stamps[0] > 2 * SPAN:
            old = bisect.bisect_left(self._stamps, stamp - SPAN)
            del self._stamps[:old], self._poses[:old]

    def _is_late(self, stamp):
        """Whether a pose at `stamp` [ns] or a little later was told before."""
        return bool(self._stamps) and 0 <= self._stamps[-1] - stamp <= LATE

    def clear(self):
        self._stamps.clear()
        self._poses.clear()

    def at(self, stamp):
        """The pose at `stamp` [ns]; None outside the time that is known."""
        after = bisect.bisect_left(self._stamps, stamp)
        if after == len(self._stamps) or after == 0 and self._stamps[0] != stamp:
            return None
        if self._stamps[after] == stamp:
            return self._poses[after]
        before = after - 1
        share = (stamp - self._stamps[before]) / (self._stamps[after] - self._stamps[before])
        return interpolate(self._poses[before], self._poses[after], share)


class HeadingHistory(PoseHistory):
    """Headings from yaw rates, as poses that turn on the spot."""

    def __init__(self):
        super().__init__()
        self._rate = 0.0

    def add_rate(self, stamp, rate):
        """Go on turning up to `stamp` [ns], at last with `rate` [rad/s]; rates that are no numbers, or come twice or late,
        are passed over."""
        if not math.isfinite(rate) or self._is_late(stamp):
            return
        heading = 0.0
        if self._stamps and stamp > self._stamps[-1]:
            heading = self._poses[-1].theta + 0.5 * (self._rate + rate) * (stamp - self._stamps[-1]) * 1e-9
        self._rate = rate
        self.add(stamp, SE2(0.0, 0.0, wrap(heading)))


def interpolate(before: SE2, after: SE2, share) -> SE2:
    """The pose that has gone `share` of the way from one to the other."""
    return SE2(before.x + share * (after.x - before.x), before.y + share * (after.y - before.y),
               wrap(before.theta + share * wrap(after.theta - before.theta)))
