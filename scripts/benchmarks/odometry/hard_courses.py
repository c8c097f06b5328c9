# SPDX-License-Identifier: Apache-2.0
"""Courses that are hard for a gate.

Key frames far apart, narrow fields of view, people who cross in front, lidars that spin up.
"""
import dataclasses
import math
from collections.abc import Callable

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.simulation import LIDARS, Lidar, Path, Person, corridor, follow, hall, rooms
from dbscan_reg_ros.simulation.raycasting import cast
from dbscan_reg_ros.simulation.worlds import sides

from ..intel import Intel
from .course import Course, driven, each, simulated

SEEDS = (0, 1, 2)
SECOND = 1_000_000_000
INTEL_DISTANCES = (0.8, 1.2, 1.6, 2.0, 2.4)
ACES_DISTANCES = (0.8, 1.2, 1.6)
SIMULATED_DISTANCES = (1.0, 1.5, 2.0, 2.5)
"""Between key frames [m]."""
TURN = math.radians(30.0)
"""A key frame is due as well when its heading changed by this [rad] for each metre of the distance."""
CAMERAS = {
    'kinect_57deg_640': Lidar(640, math.radians(-28.5), math.radians(57.0) / 639, 0.45, 6.0, 15.0, noise=0.005,
                              noise_ratio=0.01),
    'stereo_87deg_424': Lidar(424, math.radians(-43.5), math.radians(87.0) / 423, 0.3, 8.0, 15.0, noise=0.005,
                              noise_ratio=0.015),
    'flight_60deg_16': Lidar(16, math.radians(-30.0), math.radians(4.0), 0.1, 6.0, 15.0, noise=0.01, noise_ratio=0.01),
    'flight_90deg_64': Lidar(64, math.radians(-45.0), math.radians(90.0) / 63, 0.2, 5.0, 15.0, noise=0.01,
                             noise_ratio=0.01),
}
"""Depth cameras as lidars."""
NARROW_SECONDS = 25.0
PASSING_SECONDS = 20.0
PASSERS = 4
SPINUP_SECONDS = 8.0
COVERED = (0.5, 1.5, 3.0)
"""How long the box is over the lidar [s]."""
COVERED_FROM = 5.0
COVERED_LIDARS = 'rplidar_a', 'hokuyo_urg04lx', 'sick_lms200'
COVER = np.array([(-0.2, -0.25), (0.25, -0.22), (0.24, 0.3), (-0.18, 0.28)])
"""Corners of the box [m], in the frame of the sensor."""
SPIN_SECONDS = 8.0
SPIN_LIDARS = 'lds', 'rplidar_a', 'hokuyo_urg04lx'
SPINS: dict[str, Callable] = {
    'steady_1': lambda times: 1.0 * times, 'steady_3': lambda times: 3.0 * times,
    'changing': lambda times: 2.0 * times - np.cos(1.5 * times) / 1.5}
"""Name -> heading [rad] at times [s]."""
SPINUPS = {'standing_100_of_720': (1.0, (100,)), 'driving_100_of_720': (0.0, (100,)),
           'driving_0_0_200_of_720': (0.0, (0, 0, 200))}
"""Name -> how long the robot rests [s], and how many beams of the first scans return."""


def key_frames(poses, distance, start=0):
    """Return indices of scans that are `distance` [m], or 30 deg for each metre of it, from the one before."""
    chosen, (x, y, theta) = [start], poses[start]
    for k in range(start + 1, len(poses)):
        moved = math.hypot(poses[k, 0] - x, poses[k, 1] - y)
        if moved >= distance or abs(wrap(poses[k, 2] - theta)) >= TURN * distance:
            chosen.append(k)
            x, y, theta = poses[k]
    return np.array(chosen)


def thinned(course, distance, halfway=False) -> Course:
    """Return the key frames of a course, 1 s apart.

    From its first scan, or the first that is half of the `distance` [m] farther on.
    """
    start = 0
    if halfway:
        start = int(np.argmax(np.hypot(*(course.reference[:, :2] - course.reference[0, :2]).T) >= 0.5 * distance))
    kept = course.take(key_frames(course.reference, distance, start))
    scans = [dataclasses.replace(scan, stamp=k * SECOND) for k, scan in enumerate(kept.scans)]
    return dataclasses.replace(kept, scans=scans, relations=None)


def sparse_intel(folder) -> dict:
    """Name -> the Intel log thinned to key frames."""
    log = Intel(folder / 'intel')
    course = Course(log.scans, reference=log.reference)
    return {f'intel_{distance}m{"_half" * half}': thinned(course, distance, bool(half))
            for distance in INTEL_DISTANCES for half in (0, 1)}


def sparse_aces(folder) -> dict:
    """Name -> the ACES log thinned to key frames."""
    recording = open_recording(folder / 'aces' / 'aces.log.gz')
    course = Course(list(recording.scans()), reference=recording.truth()[1])
    return {f'aces_{distance}m{"_half" * half}': thinned(course, distance, bool(half))
            for distance in ACES_DISTANCES for half in (0, 1)}


def sparse_buildings(folder=None) -> dict:
    """Name -> tours through buildings, thinned to key frames."""
    courses: dict[str, Course] = {}
    kinds: dict[str, Callable] = {'rooms': rooms, 'corridor': corridor, 'hall': hall}
    for kind, make in kinds.items():
        for seed in SEEDS:
            course = simulated(make(seed=seed), LIDARS['sick_lms200'], seed)
            courses |= {f'{kind}_{seed}_{distance}m': thinned(course, distance) for distance in SIMULATED_DISTANCES}
    return courses


def sparse(folder) -> list:
    """Intel, ACES and buildings thinned to key frames 0.8 to 2.5 m apart."""
    return [*sparse_intel(folder).values(), *sparse_aces(folder).values(), *sparse_buildings().values()]


@each(CAMERAS, seeds=SEEDS)
def narrow(camera, seed) -> Course:
    """25 s through furnished rooms, seen by depth cameras of 57 to 90 deg and 16 to 640 beams."""
    return dataclasses.replace(_begun(rooms(seed), CAMERAS[camera], NARROW_SECONDS, seed), group=camera)


def _begun(world, lidar, seconds, seed, pauses=None):
    """Return the first seconds of the tour of a world."""
    path = follow(world.tour, pauses=pauses)
    kept = path.times <= seconds + lidar.duration
    return driven(world, Path(path.times[kept], path.poses[kept]), lidar, seed)


@each(seeds=SEEDS)
def passers(seed) -> Course:
    """People passing within half a metre of a lidar of 180 deg, at rest or rotating slowly, in a room or a corridor."""
    rng = np.random.default_rng(seed)
    world = corridor(seed=seed) if seed % 2 else rooms(seed)
    x, y, along = follow(world.tour).poses_at(np.array([rng.uniform(8.0, 25.0)]))[0]
    times = np.arange(0.0, PASSING_SECONDS + 0.05, 0.05)
    # Stands for 6 s, turns to and fro, stands again.
    turn = math.radians(60.0) * np.sin(np.clip(times - 6.0, 0.0, 8.0) * 2.0 * math.pi / 8.0)
    path = Path(times, np.column_stack((np.full(len(times), x), np.full(len(times), y), along + turn)))
    people = [_passer(rng, x, y, along) for _ in range(PASSERS)]
    lidar = dataclasses.replace(LIDARS['sick_lms200'], rate=5.0)
    return driven(dataclasses.replace(world, people=tuple(people)), path, lidar, seed)


def _passer(rng, x, y, heading):
    """A person walking to and fro past (x, y) [m], in any direction, before a sensor facing along `heading` [rad]."""
    away, bearing = rng.uniform(0.45, 0.8), heading + rng.uniform(-1.2, 1.2)
    nearest = np.array([x + away * math.cos(bearing), y + away * math.sin(bearing)])
    way = rng.uniform(1.5, 4.0) * np.array([-math.sin(bearing), math.cos(bearing)])
    return Person(np.array([nearest - way, nearest + way]), rng.uniform(0.8, 1.6), rng.uniform(0.2, 0.3))


@each(SPINUPS, seeds=SEEDS)
def spinup(name, seed) -> Course:
    """Return a lidar that spins up: its first scans hold none or few of its beams; the robot rests, or drives already.

    The poor scans are not judged.
    """
    pause, returns = SPINUPS[name]
    lidar = LIDARS['rplidar_a']
    whole = _begun(rooms(seed), lidar, 1.0 + SPINUP_SECONDS, seed, {0: pause} if pause else None)
    course = whole.take(slice(0 if pause else round(lidar.rate), None))
    scans = list(course.scans)
    begun = np.random.default_rng(seed).integers(lidar.beams)
    for k, count in enumerate(returns):
        kept = np.isin(np.arange(lidar.beams), (begun + np.arange(count)) % lidar.beams)
        scan = scans[k]
        scans[k] = Scan(scan.stamp, np.where(kept, scan.ranges, np.inf), scan.geometry, scan.time_increment,
                        scan.frame_id)
    return dataclasses.replace(course, scans=scans, judged=np.arange(len(scans)) >= len(returns), group=name)


@each(COVERED_LIDARS, COVERED, seeds=SEEDS)
def covered(name, seconds, seed) -> Course:
    """Return lidars under a box for 0.5 to 3 s, in furnished rooms; scans of the box are not judged."""
    course = _begun(rooms(seed), LIDARS[name], COVERED_FROM + 7.0, seed)
    under = (course.seconds >= COVERED_FROM) & (course.seconds < COVERED_FROM + seconds)
    rng, scans = np.random.default_rng(seed), list(course.scans)
    for k in under.nonzero()[0]:
        geometry = scans[k].geometry
        ranges = cast(np.zeros((1, 2)), geometry.directions, sides(COVER), np.empty((0, 3)))
        ranges += rng.normal(0.0, 0.005, geometry.size)
        scans[k] = dataclasses.replace(scans[k], ranges=np.maximum(ranges, geometry.range_min + 0.001))
    return dataclasses.replace(course, scans=scans, judged=~under, group=name)


@each(SPIN_LIDARS, SPINS, seeds=SEEDS)
def spin(lidar, name, seed) -> Course:
    """Return lidars that rotate in place in furnished rooms, steadily or not."""
    world = rooms(seed)
    x, y, heading = follow(world.tour).poses_at(np.array([10.0]))[0]
    times = np.arange(0.0, SPIN_SECONDS + 0.5, 0.01)
    path = Path(times, np.column_stack((np.full(len(times), x), np.full(len(times), y), heading + SPINS[name](times))))
    return driven(world, path, LIDARS[lidar], seed, f'{lidar}_{name}')


COURSES = {'covered': covered, 'spin': spin, 'sparse': sparse, 'narrow': narrow, 'passers': passers, 'spinup': spinup}
"""Name -> ``courses(folder)``, as `courses.COURSES`."""
