# SPDX-License-Identifier: Apache-2.0
"""Corridors that curve, stops between doors, one pillar, swinging doors, and people who walk along."""
import dataclasses
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import as_vectors
from dbscan_reg_ros.simulation import LIDARS, Path, Person, World, corridor, follow
from dbscan_reg_ros.simulation.worlds import sides, wall

from .course import Course, driven, each

SEEDS = (0, 1, 2, 3, 4)
BOTH = 'rplidar_a', 'lds'
RADIUS, ARC, HALF_WIDTH = 8.0, math.radians(200.0), 1.1
"""Radius [m], angle [rad] and half of the width [m] of the curved corridor."""
SPEED = 0.8
BRAKES = 0.5, 1.0, 3.0
"""Accelerations of the stops [m/s^2]."""
COMPANIONS = 6, 10
DOOR_PLACES = np.arange(2.0, 20.0, 3.0)
LEAF, PERIOD = 0.9, 4.0
"""Length of a door's leaf [m], and how long it takes to open and close [s]."""


@each(seeds=SEEDS)
def curved(seed) -> Course:
    """Return a smooth corridor along an arc: the motion along it is a rotation about its centre, unobservable."""
    around = np.exp(1j * np.linspace(-0.3, ARC + 0.6, 160))
    walls = [as_vectors(radius * around) for radius in (RADIUS - HALF_WIDTH, RADIUS + HALF_WIDTH)]
    segments = np.concatenate([np.stack((each[:-1], each[1:]), axis=1) for each in walls])
    angle = np.linspace(0.0, 0.8 * ARC, 400)
    poses = np.column_stack((RADIUS * np.cos(angle), RADIUS * np.sin(angle), angle + 0.5 * math.pi))
    lidar = dataclasses.replace(LIDARS['rplidar_a'], range_max=6.0)
    return driven(World(segments, poses[:, :2]), Path(angle * RADIUS / SPEED, poses), lidar, seed)


@each(BRAKES, seeds=SEEDS)
def stops(brake, seed) -> Course:
    """Return stops from 1.5 m/s in a corridor with doors, with three accelerations."""
    way = np.array([(1.5, 0.0), (9.0, 0.0), (18.0, 0.0)])
    return driven(corridor(length=20.0, doors=4, seed=seed), follow(way, 1.5, brake, pauses={0: 0.5, 1: 2.0}),
                  LIDARS['rplidar_a'], seed)


@each(seeds=SEEDS)
def pillar(seed) -> Course:
    """Return drives along a wall with one pillar in view, which alone constrains the motion along the wall."""
    rng = np.random.default_rng(seed)
    circle = np.array([(rng.uniform(4.0, 6.0), rng.uniform(0.8, 2.5), rng.uniform(0.1, 0.25))])
    world = World(wall((-20.0, -1.5), (30.0, -1.5)), np.array([(2.0, 0.0), (8.0, 0.0)]), circle)
    lidar = dataclasses.replace(LIDARS['rplidar_a'], range_max=6.0)
    return driven(world, follow(world.tour, SPEED, pauses={0: 1.0}), lidar, seed)


@dataclass(frozen=True, eq=False)
class Edge:
    """A piece of a swinging door: a circle at a `distance` [m] from the hinge `(x, y)` [m]."""

    hinge: np.ndarray
    distance: float
    phase: float
    side: float

    def circle_at(self, time):
        """(3,) centre and radius [m] at `time` [s]."""
        angle = self.side * 0.25 * math.pi * (1.0 - math.cos(2.0 * math.pi * time / PERIOD + self.phase))
        return np.array((*(self.hinge + self.distance * np.array((math.cos(angle), math.sin(angle)))), 0.03))


@each(seeds=SEEDS)
def doors(seed) -> Course:
    """Return a corridor between offices whose doors all open and close."""
    rng, walls, leaves = np.random.default_rng(seed), [], []
    for side in (-1.0, 1.0):
        places, y = DOOR_PLACES + rng.uniform(-0.8, 0.8, len(DOOR_PLACES)), side * 1.1
        walls += [wall((0.0, y), (22.0, y), places), wall((0.0, 4.0 * y), (22.0, 4.0 * y))]
        walls += [wall((x, y), (x, 4.0 * y)) for x in DOOR_PLACES - 1.5]
        leaves += [Edge(np.array((x - 0.45, y)), distance, phase, side)
                   for x, phase in zip(places, rng.uniform(0.0, 2.0 * math.pi, len(places)), strict=True)
                   for distance in np.arange(0.03, LEAF, 0.06)]
    walls += [sides(np.array([(x, -1.2), (x + 0.1, -1.2), (x + 0.1, 1.2), (x, 1.2)])) for x in (-0.1, 22.0)]
    world = World(np.concatenate(walls), np.array([(1.0, 0.0), (20.0, 0.0)]), people=tuple(leaves))
    return driven(world, follow(world.tour, SPEED), LIDARS['rplidar_a'], seed)


@each(COMPANIONS, seeds=SEEDS)
def companions(count, seed) -> Course:
    """Return six and ten people around a robot who walk along with it, within 0.07 m/s of its speed."""
    world, rng = corridor(length=30.0, width=5.0, doors=8, seed=seed), np.random.default_rng(seed)
    angles = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False) + rng.uniform(-0.2, 0.2, count)
    away = as_vectors(rng.uniform(1.0, 1.8, count) * np.exp(1j * angles)) * (1.0, 0.9)
    route = np.array([(4.0, 0.0), (26.0, 0.0)])
    people = tuple(Person(route + each, SPEED + rng.uniform(-0.07, 0.07), 0.2) for each in away)
    times = np.linspace(0.0, 18.0, 400)
    path = Path(times, np.column_stack((4.0 + SPEED * times, np.zeros((len(times), 2)))))
    return driven(dataclasses.replace(world, people=people), path, LIDARS['rplidar_a'], seed)


def ahead(folder=None, seeds=SEEDS[:1], widths=(0.5, 0.8, 1.2), distances=(1.0, 2.0, 3.0)) -> list:
    """Return a corridor with doors and a vehicle ahead of the robot, or one ahead and one behind, at its speed."""
    courses = []
    for lidar, width, seed, distance, places in itertools.product(BOTH, widths, seeds, distances,
                                                                  ((1.0,), (1.0, -1.0))):
        path = follow(np.array([(4.0, 0.0), (25.9, 0.0)]), 1.0)
        pieces = np.array([(side * distance, y, 0.03) for side in places
                           for y in np.arange(0.03 - 0.5 * width, 0.5 * width, 0.06)])
        courses.append(driven(corridor(seed=seed), path, LIDARS[lidar], seed, f'{lidar}_{width}m',
                              lambda time, pieces=pieces: pieces))
    return courses


COURSES: dict[str, Callable] = {
    'curved': curved, 'stops': stops, 'pillar': pillar, 'doors': doors, 'companions': companions, 'ahead': ahead}
"""Name -> ``courses(folder)``, as `courses.COURSES`."""
