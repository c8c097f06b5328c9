# SPDX-License-Identifier: Apache-2.0
"""Poses and velocities of the first lidar by its own scans, interpolated at the stamps of further lidars."""
import itertools
from collections import deque
from typing import NamedTuple

from ...geometry.array_types import FloatArray
from ...geometry.se2 import SE2
from ...geometry.symmetric_matrix import diagonal
from ...scan import SECOND


class TimedMotion(NamedTuple):
    """Pose and velocity of the first lidar at one time.

    Attributes
    ----------
    pose : SE2
    twist : (3,) float
        In the frame of the first lidar [m/s, m/s, rad/s].
    covariance : (3, 3) float
        Covariance of `pose` from accelerations between scans that are far apart, in its frame [m, m, rad].
    """

    pose: SE2
    twist: FloatArray
    covariance: FloatArray


class FirstLidar:
    """The last poses of the first lidar, each by one of its own scans."""

    def __init__(self) -> None:
        self._poses: deque[tuple[int, SE2]] = deque(maxlen=_POSES)

    def add(self, stamp: int, pose: SE2) -> None:
        """Add the pose at a `stamp` [ns]; if stamps go back, the older poses are cleared."""
        if self._poses and stamp <= self._poses[-1][0]:
            self._poses.clear()
        self._poses.append((stamp, pose))

    def clear(self) -> None:
        """Remove all poses."""
        self._poses.clear()

    def is_heard(self, stamp: int) -> bool | None:
        """Whether the last pose is at most `_SILENT_AFTER`, or two scan periods, older than a `stamp` [ns].

        None before there are two poses.
        """
        if len(self._poses) <= 1:
            return None
        (before, _), (last, _) = self._poses[-2], self._poses[-1]
        return stamp - last <= min(max(_SILENT_AFTER, 2 * (last - before)), _LONGEST_WAIT)

    def must_wait(self, stamp: int) -> bool:
        """Whether the motion at a `stamp` [ns] cannot be computed yet."""
        return bool(self._poses) and self._poses[-1][0] - HALF_SPAN < stamp <= self._poses[-1][0] + 2 * HALF_SPAN

    def motion_at(self, stamp: int) -> TimedMotion | None:
        """Return pose and velocity at `stamp` [ns], the latter over `HALF_SPAN` before and after; None if unknown."""
        before, found, after = (self._pose_at(stamp + offset) for offset in (-HALF_SPAN, 0, HALF_SPAN))
        if before is None or found is None or after is None:
            return None
        pose, bend = found
        inverse = pose.inverse()
        motion = (inverse @ after[0]).as_array() - (inverse @ before[0]).as_array()
        return TimedMotion(pose, motion * (0.5 * SECOND / HALF_SPAN), (bend * _ACCELERATIONS) ** 2)

    def _pose_at(self, stamp: int) -> tuple[SE2, float] | None:
        """Return the pose at `stamp` [ns], and by how much [s^2] an acceleration moves it: 0 between near scans."""
        for (start, pose), (end, following) in itertools.pairwise(self._poses):
            if start <= stamp <= end and end - start <= _FARTHEST:
                motion = (pose.inverse() @ following).as_array()
                bend = 0.5 * (stamp - start) * (end - stamp) / SECOND ** 2 if end - start > 2 * HALF_SPAN else 0.0
                return pose @ SE2.from_array(motion * ((stamp - start) / (end - start))), bend
        return None


HALF_SPAN = 200_000_000
"""Half of the time [ns] over which a velocity is measured: a compromise between noise and changes of velocity."""
_FARTHEST = 2_000_000_000
"""Time [ns] between two scans of the first lidar up to which its poses are interpolated."""
_ACCELERATIONS = diagonal(1.0, 1.0, 4.0)
"""Standard deviations of unknown accelerations [m/s^2, m/s^2, rad/s^2], as those of the motion model."""
_SILENT_AFTER = 150_000_000
"""The first lidar counts as silent after this time [ns] without a scan."""
_LONGEST_WAIT = 1_000_000_000
"""The first lidar counts as silent after this time [ns], whatever its scan period."""
_POSES = 64
"""Number of stored poses: 0.8 s at 80 Hz."""
