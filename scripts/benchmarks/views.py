# SPDX-License-Identifier: Apache-2.0
"""Two views of a simulated world from places that a robot can drive between."""
import math
from functools import lru_cache

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.simulation import follow, measure
from dbscan_reg_ros.simulation.worlds import clearance

MARGIN = 0.2
STEP = 0.1


@lru_cache(maxsize=16)
def path_along(world):
    """Return the path of a robot along the tour of a `World`."""
    return follow(world.tour)


def two_views(world, lidar, rng, motion, times=(0.0, 0.0)):
    """Two scans near the tour of a world, in any direction, and the true motion between them.

    Parameters
    ----------
    world : World
    lidar : Lidar
    rng : numpy.random.Generator
    motion : callable
        ``motion(rng)`` draws the motion, an `SE2`. It is drawn again, with the place, until the straight way between
        both places keeps 0.2 m clear of static objects, and the positions of people.
    times : (float, float)
        Of both views [s]: where people are.

    Returns
    -------
    reference, current : Scan
    truth : SE2
        Pose of the current sensor in the reference's frame.
    """
    path = path_along(world)
    while True:
        x, y, _ = path.poses_at(rng.uniform(0.0, path.duration, 1))[0]
        first = SE2(x, y, rng.uniform(-math.pi, math.pi))
        truth = motion(rng)
        poses = [first.as_array(), (first @ truth).as_array()]
        way = np.linspace(poses[0][:2], poses[1][:2], 2 + int(math.hypot(truth.x, truth.y) / STEP))
        free = all(clearance(pose[None, :2], world.segments, world.circles_at(time))[0] > MARGIN
                   for pose, time in zip(poses, times, strict=True))
        if free and clearance(way, world.segments, world.circles).min() > MARGIN:
            return *(measure(world, [pose], lidar, rng, time=time) for pose,
                     time in zip(poses, times, strict=True)), truth
