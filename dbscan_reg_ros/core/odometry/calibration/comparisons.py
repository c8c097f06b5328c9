# SPDX-License-Identifier: Apache-2.0
"""Comparison of further lidars with the first one, and the decision whether they are used."""
import math
from collections import deque
from collections.abc import Callable

from ...geometry.se2 import SE2
from ...registration.records import Status
from ...sensor import Sensor
from ..records import OdometryUpdate
from .clocks import ClockCheck
from .compared_lidar import ComparedLidar
from .first_lidar import FirstLidar
from .location import Location


class LidarComparisons:
    """Compares the scans of further lidars with the map of the first one, which counts as right.

    A further lidar is not used before it has been compared, and not while it disagrees. If the first one is silent, all
    are used.

    Parameters
    ----------
    spacing : float
        Least motion between two comparisons [m, rad].
    only : bool
        Whether further lidars are compared only, and never used.
    most : int
        Number of comparisons that are kept of each lidar.

    Attributes
    ----------
    lidars : dict
        Name of a further lidar -> `ComparedLidar`.
    """

    def __init__(self, spacing: float = 0.4, only: bool = False, most: int = 200) -> None:
        self.lidars: dict[str, ComparedLidar] = {}
        self._spacing, self._only, self._most = spacing, only, most
        self._first = FirstLidar()
        self._clocks: dict[str, ClockCheck] = {}

    def restart(self) -> None:
        """Forget the poses of the first lidar: the odometry is reset."""
        self._first.clear()

    def uses(self, sensor: Sensor, stamp: int, first_maps: bool) -> bool:
        """Whether the scan of a `sensor` at a `stamp` [ns] may change the track.

        `first_maps` is whether the first lidar has just added to the map; it counts until the comparisons know.
        """
        if not sensor.rank:
            for clock in self._clocks.values():
                clock.add_first(stamp)
            return True
        clock = self._clocks.setdefault(sensor.name, ClockCheck())
        clock.add_further(stamp)
        lidar = self.lidars.get(sensor.name)
        if lidar is None or _differs(lidar.given, sensor.pose):
            lidar = self.lidars[sensor.name] = ComparedLidar(
                sensor.pose, deque(maxlen=self._most), uses=lidar is not None)
        lidar.apart = clock.apart
        if self._only or lidar.apart:
            return False
        heard = self._first.is_heard(stamp)
        return lidar.uses or not (first_maps if heard is None else heard)

    def add(self, update: OdometryUpdate, locate: Callable[[OdometryUpdate], Location | None]) -> None:
        """Add the `update` of a scan; `locate` returns the location of this scan in the map of the first lidar."""
        if update.sensor.rank:
            lidar = self.lidars[update.sensor.name]
            if not lidar.apart and self._first.is_heard(update.stamp) and lidar.is_due(update.pose, self._spacing):
                location = locate(update)
                if location is not None:
                    lidar.wait(location)
        elif update.registration is not None and update.status is not Status.FAILED:
            self._first.add(update.stamp, update.pose)
            for lidar in self.lidars.values():
                lidar.resolve(self._first)


def _differs(before: SE2, now: SE2) -> bool:
    """Whether a mounting has changed: the lidar is used with the new one at once, and compared again."""
    motion = before.inverse() @ now
    return math.hypot(motion.x, motion.y) > _CHANGED or abs(motion.theta) > _CHANGED


_CHANGED = 0.005
"""A mounting that changes by more than this [m, rad] is another one."""
