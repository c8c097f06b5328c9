# SPDX-License-Identifier: Apache-2.0
"""One course: scans in order, with the truth that odometry is judged by."""
import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from dbscan_reg_ros.recordings import interpolate
from dbscan_reg_ros.simulation import Lidar, follow, simulate, wheel_odometry


@dataclass(frozen=True, eq=False)
class Course:
    """Scans in order, and the true motion of the sensor.

    Attributes
    ----------
    scans : list of Scan
    judged : (N,) bool
        The scans that count; the others only disturb.
    indices : (N,) int
        Each scan's number in the recording.
    reference : (N, 3) float or None
        True pose [m, m, rad] at each scan.
    relations : Relations or None
    wheels : (N, 3) float or None
        Pose of the sensor by the wheels at each scan.
    axis : float or None
        Unobservable direction [rad] in the frame of `reference`.
    others : tuple of (Sensor, list of Scan)
        Further lidars, on sensors in the frame of that of `scans`, with their scans in order; used besides.
    """

    scans: list
    judged: np.ndarray | None = None
    indices: np.ndarray | None = None
    reference: np.ndarray | None = None
    relations: object = None
    wheels: np.ndarray | None = None
    axis: float | None = None
    others: tuple = ()

    def __post_init__(self):
        if self.judged is None:
            object.__setattr__(self, 'judged', np.ones(len(self.scans), dtype=bool))
        if self.indices is None:
            object.__setattr__(self, 'indices', np.arange(len(self.scans)))

    @property
    def stamps(self):
        """``(N,)`` int64 stamps [ns]."""
        return np.array([scan.stamp for scan in self.scans], dtype=np.int64)

    @property
    def seconds(self):
        """(N,) float [s] since the first scan."""
        return 1e-9 * (self.stamps - self.stamps[0])

    def take(self, chosen) -> 'Course':
        """Return the scans `chosen`, by index or mask."""
        def rows(values):
            return None if values is None else values[chosen]
        picked = np.arange(len(self.scans))[chosen]
        return dataclasses.replace(
            self, scans=[self.scans[i] for i in picked], judged=rows(self.judged), indices=rows(self.indices),
            reference=rows(self.reference), wheels=rows(self.wheels))


def simulated(world, lidar=Lidar(), seed=0, axis=None, seconds=math.inf, **motion) -> Course:
    """Return the tour of a world, or so many seconds of it, with the `motion` of `follow`."""
    result = simulate(world, follow(world.tour, **motion).until(seconds), lidar, seed)
    wheels = interpolate(*wheel_odometry(result.path, seed=seed), result.stamps)
    course = Course(result.scans, reference=result.truth, wheels=wheels, axis=axis)
    return course.take(np.isfinite(wheels).all(axis=1))
