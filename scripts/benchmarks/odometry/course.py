# SPDX-License-Identifier: Apache-2.0
"""One course: scans in order, with the truth that odometry is judged by."""
import dataclasses
import itertools
import math
from dataclasses import dataclass

import numpy as np

from dbscan_reg_ros.recordings import interpolate
from dbscan_reg_ros.simulation import Lidar, follow, simulate, wheel_odometry
from dbscan_reg_ros.simulation.dead_reckoning import WheelErrors
from dbscan_reg_ros.simulation.raycasting import cast

NOISE = 0.002
"""Standard deviation that a copy adds to each range [m]."""


@dataclass(frozen=True, eq=False)
class Course:
    """Scans in order, and the true motion of the sensor."""

    scans: list
    """list of Scan"""
    judged: np.ndarray | None = None
    """The scans that count ``(N,)`` bool; the others only disturb."""
    indices: np.ndarray | None = None
    """Each scan's number in the recording ``(N,)`` int."""
    reference: np.ndarray | None = None
    """True pose [m, m, rad] at each scan ``(N, 3)``."""
    relations: object = None
    """Relations"""
    wheels: np.ndarray | None = None
    """Pose of the sensor by the wheels at each scan ``(N, 3)``."""
    axis: float | None = None
    """Unobservable direction [rad] in the frame of `reference`."""
    others: tuple = ()
    """tuple of (Sensor, list of Scan): further lidars, on sensors in the frame of that of `scans`, with their scans in
    order; used besides."""
    group: str = ''
    """What it differs by from others of its name besides the seed, for example the lidar."""
    truth_sigma: tuple = (0.0, 0.0)
    """(float, float): standard deviation of `reference`, along each axis and in heading [m], [rad]."""

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


def each(*kinds, seeds):
    """Turn a function of the `kinds` and of a seed, which makes a course, into one of seeds that lists all of them."""
    def listing(make):
        def courses(folder=None, seeds=seeds):
            return [make(*kind, seed) for *kind, seed in itertools.product(*kinds, seeds)]

        courses.__name__, courses.__doc__ = make.__name__, make.__doc__
        return courses

    return listing


def behind(scan, circles, rng):
    """Return what a scan sees behind `circles` (C, 3) [m] in the frame of the sensor, with a noise of 1 cm on these."""
    nearer = cast(np.zeros((1, 2)), scan.geometry.directions, np.empty((0, 2, 2)), circles)
    nearer += rng.normal(0.0, 0.01, len(nearer))
    return dataclasses.replace(scan, ranges=np.where(scan.valid, np.minimum(scan.ranges, nearer), nearer))


def simulated(world, lidar=Lidar(), seed=0, axis=None, seconds=math.inf, slips=(), **motion) -> Course:
    """Return the tour of a world, or so many seconds of it, with the `motion` of `follow`; `slips` as `WheelErrors`."""
    result = simulate(world, follow(world.tour, **motion).until(seconds), lidar, seed)
    wheels = interpolate(*wheel_odometry(result.path, WheelErrors(slips=slips), seed=seed), result.stamps)
    course = Course(result.scans, reference=result.truth, wheels=wheels, axis=axis)
    return course.take(np.isfinite(wheels).all(axis=1))


def driven(world, path, lidar, seed, group='', carried=None) -> Course:
    """Return a drive along a path; `carried(time)` are circles (C, 3) that move along, in the frame of the sensor."""
    result, rng = simulate(world, path, lidar, seed), np.random.default_rng((seed, 1))
    scans = result.scans
    if carried:
        scans = [behind(scan, carried(1e-9 * (scan.stamp - scans[0].stamp)), rng) for scan in scans]
    return Course(scans, reference=result.truth, group=group)


def noised(course, seed):
    """Return the course with noise on every range that is a return, the same for the same seed."""
    rng = np.random.default_rng(seed)
    scans = []
    for scan in course.scans:
        noise = rng.normal(0.0, NOISE, scan.geometry.size)
        ranges = np.where(scan.valid, np.clip(scan.ranges + noise, scan.geometry.range_min, scan.geometry.range_max),
                          scan.ranges)
        scans.append(dataclasses.replace(scan, ranges=ranges))
    return dataclasses.replace(course, scans=scans)


def scatter(rows):
    """Means, and two standard errors of them, of the metrics that all `rows` have."""
    shared = [name for name in rows[0] if all(name in row for row in rows)]
    values = {name: np.array([row[name] for row in rows], dtype=float) for name in shared}
    spread = {name: 2.0 * float(each.std(ddof=1)) / len(rows)**0.5 if len(rows) > 1 else float('nan')
              for name, each in values.items()}
    return {name: float(each.mean()) for name, each in values.items()}, spread
