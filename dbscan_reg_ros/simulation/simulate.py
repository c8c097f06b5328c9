# SPDX-License-Identifier: Apache-2.0
"""Simulation of scans along a path through a world, with the exact true poses."""
from dataclasses import dataclass

import numpy as np

from ..core.geometry.se2 import SE2
from ..core.scan import Scan
from .lidar import Lidar
from .paths import Path, follow
from .raycasting import cast
from .worlds import World, rooms

START = 1_700_000_000 * 10**9
"""Stamp of the first scan [ns]."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """A simulated recording."""

    scans: list[Scan]
    truth: np.ndarray
    """Pose x, y [m], theta [rad] of the *sensor* in the world at the stamp of each scan, the time of its first beam
    ``(N, 3)``."""
    world: World
    path: Path
    lidar: Lidar

    @property
    def stamps(self):
        """Stamps of the scans ``(N,)``, int64 [ns]."""
        return np.array([scan.stamp for scan in self.scans], dtype=np.int64)


def simulate(world, path, lidar=Lidar(), seed=0, start=START) -> Simulation:
    """Simulate the scans of `lidar` along the `path` of the robot, from the stamp `start` [ns] on.

    The sensor is mounted at `lidar.mounting`; the same seed gives the same scans.
    """
    rng = np.random.default_rng(seed)
    times = np.arange(lidar.phase, path.duration - lidar.duration, 1.0 / lidar.rate)
    scans = []
    for time in times:
        seen = lidar.of_one_scan(rng)
        scans.append(measure(world, path.poses_at(time + seen.times()), seen, rng, start + round(time * 1e9), time))
    return Simulation(scans, _mounted(path.poses_at(times), lidar.mounting), world, path, lidar)


def measure(world, poses, lidar, rng, stamp=0, time=0.0) -> Scan:
    """Simulate one scan with a `stamp` [ns] of a robot at `poses` ``(B, 3)`` at each beam, or ``(1, 3)`` [m, m, rad].

    People are where they are at `time` [s].
    """
    sensor = _mounted(np.asarray(poses, dtype=float), lidar.mounting)
    angles = sensor[:, 2] + lidar.geometry.bearings
    directions = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    distances = cast(sensor[:, :2], directions, world.segments, world.circles_at(time))
    return Scan(stamp, lidar.measured(distances, rng), lidar.geometry, lidar.time_increment, lidar.frame_id)


def demo(seed=1) -> Simulation:
    """Return the building of ``scripts/demo``: a tour of eight rooms and back along the corridor, scanned at 10 Hz."""
    world = rooms(seed)
    pauses = {0: 1.0, len(world.tour) - 1: 1.0}
    path = follow(world.tour, speed=1.2, acceleration=0.8, turn_rate=1.2, radius=0.5, pauses=pauses)
    return simulate(world, path, seed=seed)


def _mounted(poses, mounting: SE2):
    """Return the poses (N, 3) of a sensor with this `mounting` on a robot at `poses`."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    return np.stack((poses[:, 0] + c * mounting.x - s * mounting.y, poses[:, 1] + s * mounting.x + c * mounting.y,
                     poses[:, 2] + mounting.theta), axis=1)
