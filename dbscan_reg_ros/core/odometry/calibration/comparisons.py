# SPDX-License-Identifier: Apache-2.0
"""Comparison of further lidars with the first one, and the decision whether they are used."""
import dataclasses
import math
from collections import deque
from collections.abc import Callable

from ...geometry.se2 import SE2
from ...registration.records import Prior, Status
from ...sensor import Sensor
from ..records import OdometryUpdate
from .clocks import ClockCheck
from .compared_lidar import ComparedLidar
from .first_lidar import FirstLidar
from .location import Location
from .wheels import WheelComparison


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
    calibrate : bool
        Whether the estimated mounting of a lidar is used if the given one is certainly wrong.
    base : SE2
        Pose of the base, whose motion external priors measure, in the followed frame.

    Attributes
    ----------
    lidars : dict
        Name of a further lidar -> `ComparedLidar`.
    """

    def __init__(self, spacing: float = 0.2, only: bool = False, most: int = 200, calibrate: bool = False,
                 base: SE2 = SE2()) -> None:
        self.lidars: dict[str, ComparedLidar] = {}
        self._spacing, self._only, self._most, self._calibrate = spacing, only, most, calibrate
        self._first, self._wheels = FirstLidar(), WheelComparison(base)
        self._clocks: dict[str, ClockCheck] = {}

    def restart(self) -> None:
        """Forget the poses of the first lidar: the odometry is reset."""
        self._first.clear()
        self._wheels.restart()

    def uses(self, sensor: Sensor, stamp: int) -> bool:
        """Whether the scan of a `sensor` at a `stamp` [ns] may change the track."""
        if not sensor.rank:
            for clock in self._clocks.values():
                clock.add_first(stamp)
            return True
        clock = self._clocks.setdefault(sensor.name, ClockCheck())
        clock.add_further(stamp)
        lidar = self.lidars.get(sensor.name)
        if lidar is None or _differs(lidar.given, sensor.pose):
            lidar = self.lidars[sensor.name] = ComparedLidar(
                sensor.pose, deque(maxlen=self._most), on_trial=lidar is None, calibrate=self._calibrate,
                wheels=self._wheels)
        lidar.apart = clock.apart
        if self._only or lidar.apart:
            return False
        if not self._first.is_heard(stamp):
            return True
        return not lidar.on_trial and not lidar.disagrees

    def mounted(self, sensor: Sensor) -> Sensor:
        """Return a `sensor` with the mounting that is used."""
        lidar = self.lidars.get(sensor.name) if sensor.rank else None
        return sensor if lidar is None else _with_pose(sensor, lidar.used)

    def guessed(self, sensor: Sensor) -> Sensor:
        """Return a `sensor` with the mounting that it probably has, whether it is used or not."""
        lidar = self.lidars.get(sensor.name) if sensor.rank else None
        return sensor if lidar is None else _with_pose(sensor, lidar.guess)

    def add(self, update: OdometryUpdate, locate: Callable[[OdometryUpdate, SE2 | None], Location | None],
            prior: Prior | None = None) -> None:
        """Add the `update` of a scan and its external `prior`.

        `locate` returns the location of this scan in the map of the first lidar, for a mounting that may be wrong by
        0.3 m and 10 deg, or is None: not known.
        """
        sensor = update.sensor
        if self.lidars:
            self._wheels.add(update, prior)
        if sensor.rank:
            lidar = self.lidars[sensor.name]
            if not lidar.apart and self._first.is_heard(update.stamp) and lidar.is_due(update.pose, self._spacing):
                for guess in (lidar.guess, None) if lidar.must_search() else (lidar.guess,):
                    location = locate(update, guess)
                    if location is not None:
                        lidar.wait(location)
        elif update.registration is not None and update.status is not Status.FAILED:
            self._first.add(update.stamp, update.pose)
            for lidar in self.lidars.values():
                lidar.resolve(self._first)


def _with_pose(sensor: Sensor, pose: SE2) -> Sensor:
    return sensor if sensor.pose == pose else dataclasses.replace(sensor, pose=pose)


def _differs(before: SE2, now: SE2) -> bool:
    """Whether a mounting has changed: the lidar is used with the new one at once, and compared again."""
    motion = before.inverse() @ now
    return math.hypot(motion.x, motion.y) > _CHANGED or abs(motion.theta) > _CHANGED


_CHANGED = 0.005
"""A mounting that changes by more than this [m, rad] is another one."""
