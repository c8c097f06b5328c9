# SPDX-License-Identifier: Apache-2.0
"""Courses on which scans or wheels mislead: people and robots that move along, equal pillars, hedges, wheel slip.

All are seen by an RPLIDAR A and an LDS.
"""
import dataclasses
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import as_vectors
from dbscan_reg_ros.simulation import LIDARS, Path, World, corridor, follow, hall, rooms
from dbscan_reg_ros.simulation.worlds import box, furnished, furniture, sides, wall

from .course import Course, driven, each, simulated
from .hard_courses import thinned
from .moving_courses import BOTH
from .places import hall_of_chairs, wood

SEEDS = (0, 1, 2)
HEDGE, SHARE, DEEP = 1.2, 0.3, 0.4
"""Distance of a hedge [m]; fraction of the beams that end inside, and how far at most [m]."""
PAUSES = 0.0, 1.0, 3.0
GAPS = 8.0, 12.0, 20.0
BEFORE, AFTER = 10.0, 12.0
"""How long the robot drives before and after a gap [s]."""
CARRIED = 2.0
"""How long a robot is carried [s]."""
SLIPS = {'half': (2.0, 0.5), 'lost': (0.4, 0.0), 'more': (2.0, 1.4)}
"""Name -> how long [s] the wheels measure which multiple of the distance."""
SLIPS_AT = 8.0, 18.0, 28.0
KEPT = 1.0, 1.0, 1.0, 1.0, 2.4
"""Times between the key frames of the crowd [s]."""


@dataclass(frozen=True, eq=False)
class Walker:
    """A person on a path: a circle at `offset` (2,) [m] from it."""

    path: Path
    offset: np.ndarray

    def circle_at(self, time):
        """(3,) centre and radius [m] at `time` [s]."""
        return np.array((*(self.path.poses_at(np.array([time]))[0, :2] + self.offset), 0.22))


def legs(x, y, heading, *pieces) -> Path:
    """Return the path of pieces (seconds, metres forward, radians), each either straight or on the spot."""
    times, poses = [np.zeros(1)], [np.array([(x, y, heading)])]
    for seconds, metres, angle in pieces:
        share = np.linspace(0.0, 1.0, 2 + int(100.0 * seconds))[1:]
        smooth = share ** 2 * (3.0 - 2.0 * share)
        x, y, heading = poses[-1][-1]
        ways = np.array((metres * math.cos(heading), metres * math.sin(heading), angle))
        times.append(times[-1][-1] + seconds * share)
        poses.append((x, y, heading) + smooth[:, None] * ways)
    return Path(np.concatenate(times), np.concatenate(poses))


@each(BOTH, seeds=SEEDS[:1])
def abreast(lidar, seed) -> Course:
    """Return a hall of 40 x 30 m, an equal robot 0.9 m beside, another 1.3 m ahead, speeds within 5 %."""
    rng = np.random.default_rng(seed)
    periods, phases = rng.uniform(4.0, 8.0, 2), rng.uniform(0.0, 2.0 * math.pi, 2)

    def robots(time, periods=periods, phases=phases):
        sway = 0.05 * periods / (2.0 * math.pi) * np.sin(2.0 * math.pi * time / periods + phases)
        return np.array(((0.0, 0.9, 0.25), (1.3, 0.0, 0.25))) + np.outer(sway, (1.0, 0.0, 0.0))

    path = Path(np.array((0.0, 30.0)), np.array(((5.0, 15.0, 0.0), (35.0, 15.0, 0.0))))
    return driven(hall(seed, 40.0, 30.0), path, LIDARS[lidar], seed, lidar, robots)


@each(BOTH, seeds=SEEDS[:1])
def queue(lidar, seed) -> Course:
    """Return a queue of people 0.85 m apart between poles that moves up 0.8 m every 5 s, walls 8 m away."""
    rng = np.random.default_rng(seed)
    pieces = [(rng.uniform(3.5, 4.5), 0.0, 0.0), *(8 * [(1.0, 0.8, 0.0), (4.0, 0.0, 0.0)])]
    path = legs(0.0, 0.0, 0.0, *pieces)
    people = []
    for place in (-3, -2, -1, 1, 2, 3, 4):
        late = legs(0.0, 0.0, 0.0, (pieces[0][0] - 0.15 * place + rng.uniform(-0.1, 0.1), 0.0, 0.0), *pieces[1:])
        people.append(Walker(late, np.array((0.85 * place, rng.uniform(-0.1, 0.1)))))
    poles = [(x, y, 0.03) for x in np.arange(-4.0, 12.0, 1.8) for y in (-0.6, 0.6)]
    corners = np.array([(-8.0, -8.0), (14.0, -8.0), (14.0, 8.0), (-8.0, 8.0)])
    world = World(sides(corners), path.poses[:, :2], np.array(poles), tuple(people))
    return driven(world, path, LIDARS[lidar], seed, lidar)


@each(BOTH, (False, True), seeds=SEEDS[:1])
def hedge(lidar, fixed, seed) -> Course:
    """Return a hedge in which 30 % of the beams end 0 to 0.4 m inside: others in each scan, or at fixed places."""
    rng, path = np.random.default_rng(seed), follow(np.array([(0.0, 0.0), (7.3, 0.0)]))
    x = np.arange(-15.0, 23.0, 0.05)
    y = -HEDGE - (rng.uniform(0.0, DEEP, len(x)) * (rng.random(len(x)) < SHARE) if fixed else np.zeros(len(x)))
    leaves = np.stack((np.column_stack((x, y)), np.column_stack((x + 0.05, y))), axis=1)
    course = driven(World(leaves, path.poses[:, :2]), path, LIDARS[lidar], seed,
                    f'{lidar}_{"fixed" if fixed else "new"}')
    return course if fixed else _scattered(course, rng)


def _scattered(course, rng):
    """Return the course with other beams in each scan that end inside the hedge."""
    scans = [dataclasses.replace(scan, ranges=scan.ranges + np.where(
        rng.random(scan.geometry.size) < SHARE, rng.uniform(0.0, DEEP, scan.geometry.size), 0.0))
        for scan in course.scans]
    return dataclasses.replace(course, scans=scans)


@each(BOTH, PAUSES, seeds=SEEDS[:1])
def pillars(lidar, pause, seed) -> Course:
    """Return equal pillars every 5 m, and a robot that turns by 90 deg right after a pause and drives on."""
    places = 5.0 * np.arange(-4, 5)
    circles = np.array([(x, y, 0.25) for x in places for y in places])
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(1.2, 3.8, 2)
    side = rng.choice((-0.5, 0.5)) * math.pi
    path = legs(x, y, 0.0, (pause, 0.0, 0.0), (3.0, 0.0, side), (12.0, 8.0, 0.0))
    world = World(np.empty((0, 2, 2)), path.poses[:, :2], circles)
    return driven(world, path, LIDARS[lidar], seed, f'{lidar}_{pause:g}s')


def carried(folder=None, seeds=SEEDS[:1]) -> list:
    """Return a robot that is carried to another room, and robots without scans for 8, 12, 20 s while they move on."""
    courses = []
    for lidar, seed in itertools.product(BOTH, seeds):
        course = driven(*other_room(seed), LIDARS[lidar], seed, f'{lidar}_room')
        courses.append(dataclasses.replace(course, scans=[
            dataclasses.replace(scan, ranges=np.full(scan.geometry.size, np.inf)) if covered else scan
            for scan, covered in zip(course.scans, np.abs(course.seconds - 0.5 * CARRIED - BEFORE) <= 0.5 * CARRIED,
                                     strict=True)]))
    for lidar, gap, seed in itertools.product(BOTH, GAPS, seeds):
        speed = np.random.default_rng(seed).uniform(4.0, 8.0) / gap
        course = simulated(rooms(seed), LIDARS[lidar], seed, seconds=BEFORE + gap + AFTER, speed=speed)
        course = course.take(np.abs(course.seconds - 0.5 * gap - BEFORE) >= 0.5 * gap)
        courses.append(dataclasses.replace(course, group=f'{lidar}_gap'))
    return courses


def other_room(seed):
    """Return two rooms of one size with other furniture, one wall in another place, and the path in both."""
    rng = np.random.default_rng(seed)
    walls, boxes, bins = [], [], []
    for x, length in ((0.0, 6.0), (12.0, 7.0)):
        corners = np.array([(x, 0.0), (x + length, 0.0), (x + length, 5.0), (x, 5.0)])
        walls.append(sides(corners))
        things = furniture((x, x + length, 0.0, 5.0), rng)
        boxes, bins = boxes + things[0], bins + things[1]
    drive = [(5.0, 3.0, 0.0), (2.0, 0.0, 0.5 * math.pi), (3.0, 1.5, 0.0)]
    first = legs(1.5, 1.5, 0.0, *drive)
    second = legs(13.5, 1.5, rng.uniform(-0.3, 0.3), *drive, (2.0, 0.0, 0.5 * math.pi), (6.0, 2.0, 0.0))
    path = Path(np.concatenate((first.times, first.times[-1] + CARRIED + second.times)),
                np.vstack((first.poses, second.poses)))
    tours = [np.array([(x, 1.5), (x + 3.0, 1.5), (x + 3.0, 3.0)]) for x in (1.5, 13.5)]
    return furnished(walls, boxes, bins, np.concatenate(tours)), path


@each(BOTH, (5.0, 2.0), seeds=SEEDS[:1])
def vacuum(lidar, rate, seed) -> Course:
    """Return a robot vacuum among chair legs, 0.3 m/s, that turns on the spot with 2 rad/s; scans at 5 and at 2 Hz."""
    way = [(x, y) for k, y in enumerate(np.arange(4.2, 4.9, 0.3)) for x in ((3.0, 6.0) if k % 2 else (6.0, 3.0))]
    sensor = dataclasses.replace(LIDARS[lidar], rate=rate, duration=0.199)
    path = follow(np.array(way), 0.3, turn_rate=2.0, pauses=dict.fromkeys(range(1, len(way)), 0.0))
    return driven(hall_of_chairs(seed), path, sensor, seed, f'{lidar}_{rate:g}hz')


@each(BOTH, ('tunnel', 'outdoors'), ('half', 'lost'), seeds=SEEDS[:1])
def lost_ticks(lidar, place, kind, seed) -> Course:
    """Return wheels that measure half of the distance for 2 s, or nothing for 0.4 s, in a tunnel and outdoors."""
    return _slipping(lidar, place, kind, seed)


@each(BOTH, ('tunnel', 'outdoors'), ('more',), seeds=SEEDS[:1])
def slip(lidar, place, kind, seed) -> Course:
    """Return wheels that measure 1.4 times the distance for 2 s, in a tunnel with ribs and outdoors."""
    return _slipping(lidar, place, kind, seed)


def _slipping(lidar, place, kind, seed):
    seconds, factor = SLIPS[kind]
    slips = [(begin, begin + seconds, factor) for begin in SLIPS_AT]
    world = {'tunnel': tunnel, 'outdoors': wood}[place](seed)
    course = simulated(world, LIDARS[lidar], seed, seconds=35.0, slips=slips, speed=1.0)
    return dataclasses.replace(course, group=f'{lidar}_{place}_{kind}')


def tunnel(seed) -> World:
    """Return a tunnel with ribs of 0.2 x 0.1 m about every 2.5 m."""
    rng = np.random.default_rng(seed)
    places = np.arange(1.0, 50.0, 2.5)
    ribs = [box(x, side, 0.2, 0.35, 0.0) for x in places + rng.uniform(-0.2, 0.2, len(places)) for side in (-1.5, 1.5)]
    walls = [wall((-10.0, y), (60.0, y)) for y in (-1.5, 1.5)]
    return World(np.concatenate(walls + ribs), np.array([(0.0, 0.0), (40.0, 0.0)]))


@each(BOTH, seeds=SEEDS[:1])
def sparse_crowd(lidar, seed) -> Course:
    """Return key frames 1 s apart with gaps of 2.4 s in a hall, three people always within 2 m."""
    rng, world = np.random.default_rng(seed), hall(seed)
    path = follow(world.tour).until(60.0)
    people = []
    for around in rng.uniform(-0.5, 0.5, 3):
        angles = rng.uniform(0.0, 2.0 * math.pi) + around * path.times
        away = np.column_stack((as_vectors(rng.uniform(0.9, 1.8) * np.exp(1j * angles)), np.zeros(len(angles))))
        people.append(Walker(Path(path.times, path.poses + away), np.zeros(2)))
    course = driven(dataclasses.replace(world, people=tuple(people)), path, LIDARS[lidar], seed, lidar)
    times = np.cumsum(np.resize(KEPT, 50))
    return course.take(np.searchsorted(course.seconds, times[times < course.seconds[-1]]))


@each(BOTH, seeds=SEEDS[:1])
def corridor_1m(lidar, seed) -> Course:
    """Return a corridor with doors, seen from key frames 1 m and 1 s apart."""
    return dataclasses.replace(thinned(simulated(corridor(seed=seed), LIDARS[lidar], seed), 1.0), group=lidar)


COURSES: dict[str, Callable] = {
    'abreast': abreast, 'queue': queue, 'hedge': hedge, 'pillars': pillars, 'carried': carried, 'vacuum': vacuum,
    'lost_ticks': lost_ticks, 'slip': slip, 'sparse_crowd': sparse_crowd, 'corridor_1m': corridor_1m}
"""Name -> ``courses(folder)``, as `courses.COURSES`."""
