# SPDX-License-Identifier: Apache-2.0
"""Recordings and simulated worlds with the truth that odometry is judged by, and Intel made harder."""
import dataclasses
import functools
import itertools
import math

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import SE2, as_vectors
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.core.scan_geometry import ScanGeometry
from dbscan_reg_ros.core.sensor import Sensor
from dbscan_reg_ros.recordings import interpolate, open_recording
from dbscan_reg_ros.recordings.poses import compose
from dbscan_reg_ros.simulation import LIDARS, Lidar, Path, Person, World, corridor, follow, hall, rooms, simulate

from ..intel import Intel
from . import hard_courses, misleading_courses, moving_courses
from .course import Course, behind, simulated
from .places import crooked, hall_of_chairs, wood

SEEDS = (0, 1, 2)
BURST, BURST_PERIOD = 2.0, 3.0
OUTAGE_AFTER, OUTAGE_PERIOD = 11.0, 15.0
"""Scans of the first seconds of each period remain."""
FRONT, REAR = SE2(0.35, 0.25, math.radians(45.0)), SE2(-0.35, -0.25, math.radians(-135.0))
"""Mountings of two scanners at opposite corners of a base of 0.7 x 0.5 m."""
SCANNED = 25.0
"""Length of their drives [s]."""
URG04LX_MOUNTING = np.array([(0.145, 0.0, 0.0)])


@functools.cache
def intel(folder) -> list:
    """Return the Intel log."""
    log = Intel(folder / 'intel')
    _, wheels = log.recording.wheel_odometry()
    return [Course(log.scans, reference=log.reference, relations=log.relations, wheels=wheels,
                   truth_sigma=(0.014, math.radians(0.17)))]


def dropped(folder, share=0.2, seed=0) -> list:
    """Intel without a fifth of its scans, picked at random."""
    course, = intel(folder)
    kept = np.random.default_rng(seed).random(len(course.scans)) >= share
    return [course.take(kept)]


def noise(folder, every=50, seed=0) -> list:
    """Intel with every 50th scan replaced by ranges that mean nothing."""
    course, = intel(folder)
    rng = np.random.default_rng(seed)
    scans, judged = list(course.scans), course.judged.copy()
    for k in range(every, len(scans), every):
        scans[k] = dataclasses.replace(scans[k], ranges=rng.uniform(0.2, 10.0, scans[k].geometry.size))
        judged[k] = False
    return [dataclasses.replace(course, scans=scans, judged=judged)]


def person(folder) -> list:
    """Intel with a person 0.5 m wide strolling about 1 m in front of the sensor, once for each seed."""
    course, = intel(folder)
    return [dataclasses.replace(course, scans=strolled(course.scans, seed)) for seed in SEEDS]


def strolled(scans, seed, radius=0.25) -> list:
    """Return the scans with a person of this radius [m] strolling to and fro about 1 m in front of the sensor."""
    rng = np.random.default_rng(seed)
    bearing, hidden = 0.0, []
    for scan in scans:
        bearing = float(np.clip(bearing + rng.normal(0.0, 0.15), -1.0, 1.0))
        hidden.append(behind(scan, np.array([(math.cos(bearing), math.sin(bearing), radius)]), rng))
    return hidden


def aces(folder) -> list:
    """Return the ACES log: key frames half a metre and more apart; truth are its corrected poses, good to 5 cm."""
    recording = open_recording(folder / 'aces' / 'aces.log.gz')
    return [Course(list(recording.scans()), reference=recording.truth()[1],
                   wheels=recording.wheel_odometry()[1], truth_sigma=(0.05, 0.0))]


def urg04lx(folder) -> list:
    """Return a corridor seen no farther than 4 m; truth are the wheels, carried to the sensor."""
    recording = open_recording(folder / 'urg04lx' / 'exp1')
    scans = list(recording.scans())
    wheels = interpolate(*recording.wheel_odometry(), [scan.stamp for scan in scans])
    wheels = compose(wheels, np.repeat(URG04LX_MOUNTING, len(scans), axis=0))
    course = Course(scans, reference=wheels, wheels=wheels)
    return [course.take(np.isfinite(wheels).all(axis=1))]


def lms511(folder) -> list:
    """Return a stationary sensor, 7 s."""
    scans = list(open_recording(folder / 'lms511' / 'static').scans())
    return [Course(scans, reference=np.zeros((len(scans), 3)))]


def simulated_rooms(folder) -> list:
    """Tours through furnished rooms."""
    return [simulated(rooms(seed), seed=seed) for seed in SEEDS]


def simulated_corridors(folder) -> list:
    """Corridors whose doors are recesses, there and back."""
    courses = []
    for seed in SEEDS:
        world = corridor(seed=seed)
        there_and_back = dataclasses.replace(world, tour=np.vstack((world.tour, world.tour[:1])))
        courses.append(simulated(there_and_back, seed=seed))
    return courses


def simulated_halls(folder) -> list:
    """Tours through halls with columns."""
    return [simulated(hall(seed), seed=seed) for seed in SEEDS]


def featureless(folder) -> list:
    """Return a smooth corridor, both ends out of the sensor's range, seen by each of the common lidars."""
    world = corridor(length=60.0, doors=0)
    middle = dataclasses.replace(world, tour=np.array([(15.0, 0.0), (45.0, 0.0)]))
    return [simulated(middle, dataclasses.replace(lidar, range_max=min(lidar.range_max, 12.0)), axis=0.0)
            for lidar in (Lidar(), *LIDARS.values())]


def round_room(folder) -> list:
    """Return a circular room, 6 m wide, by each of the lidars: the rotation about its centre is unobservable."""
    corners = as_vectors(3.0 * np.exp(2j * math.pi / 180 * np.arange(181)))
    tour = np.array([(0.0, 0.0), (1.5, 0.0), (0.0, 1.5), (-1.5, 0.0), (0.0, -1.5), (0.0, 0.0)])
    world = World(np.stack((corners[:-1], corners[1:]), axis=1), tour)
    return [simulated(world, lidar) for lidar in (Lidar(), *LIDARS.values())]


def chairs(folder) -> list:
    """Return a hall full of chairs; from its middle a lidar of 4 m sees of it no more than legs of 4 cm."""
    lidar = LIDARS['hokuyo_urg04lx']
    return [simulated(hall_of_chairs(seed), lidar, seed=seed) for seed in SEEDS]


def trees(folder) -> list:
    """Return a wood of trunks 0.12 to 0.7 m thick; a lidar of 180 beams has one or two beams on each of a few."""
    return [simulated(wood(seed), seed=seed) for seed in SEEDS]


def lidars(folder) -> list:
    """Return a corridor whose doors are recesses, seen by each of the common lidars: some hardly see the doors."""
    return [simulated(corridor(seed=1), lidar, seed=1) for lidar in LIDARS.values()]


def leader(folder) -> list:
    """Corridors whose doors are recesses, with a person walking ahead of the sensor, as fast as it drives."""
    worlds = [corridor(seed=seed) for seed in SEEDS]
    people = [(Person(world.tour + np.array((1.2, 0.0)), speed=0.8),) for world in worlds]
    return [simulated(dataclasses.replace(world, people=ahead), seed=seed)
            for world, ahead, seed in zip(worlds, people, SEEDS, strict=True)]


def far_noise(folder, share=0.03) -> list:
    """Return halls and crooked rooms, by a lidar whose ranges are off by 3 %, as those of the cheapest ones."""
    lidar = dataclasses.replace(LIDARS['rplidar_a'], noise_ratio=share)
    return [simulated(world(seed), lidar, seed=seed) for world in (hall, crooked) for seed in SEEDS]


def losses(folder, share=0.5) -> list:
    """Tours through furnished rooms by a lidar whose scan takes the whole interval, and half of its scans are lost."""
    courses = [simulated(rooms(seed), LIDARS['rplidar_a'], seed=seed) for seed in SEEDS]
    return [course.take(np.random.default_rng(seed).random(len(course.scans)) >= share)
            for course, seed in zip(courses, SEEDS, strict=True)]


def bursts(folder) -> list:
    """Return a short corridor, there and back, by each lidar of 4 m range, without scans in every third second."""
    courses = []
    for lidar in (LIDARS['hokuyo_urg04lx'], LIDARS['lds']):
        for seed in SEEDS:
            world = corridor(length=14.0, doors=4, seed=seed)
            there_and_back = dataclasses.replace(world, tour=np.vstack((world.tour, world.tour[:2])))
            course = simulated(there_and_back, lidar, seed=seed, speed=1.2, acceleration=1.0, turn_rate=1.6)
            courses.append(course.take(course.seconds % BURST_PERIOD < BURST))
    return courses


def outages(folder) -> list:
    """Return a wood, seen by lidars with a long range, without scans in the last four of every fifteen seconds."""
    courses = [simulated(wood(seed), LIDARS[name], seed=seed) for name in ('rplidar_a', 'rplidar_s', 'sick_lms5xx')
               for seed in SEEDS]
    return [course.take(course.seconds % OUTAGE_PERIOD < OUTAGE_AFTER) for course in courses]


def scanner_front(folder) -> list:
    """Return the front scanner of `scanners` alone."""
    return [dataclasses.replace(course, others=()) for course in scanners(folder)]


def scanner_rear(folder) -> list:
    """Return the rear scanner of `scanners` alone."""
    return [Course(rear.scans, reference=rear.truth) for _, rear in _scanned()]


def scanners(folder) -> list:
    """Return two safety scanners of 270 deg at opposite corners of a base, not synchronised, each with its own scans.

    They drive through furnished rooms, corridors whose doors are recesses, and halls. Poses are those of the front one.
    """
    sensor = Sensor('rear', FRONT.inverse() @ REAR, rank=1)
    return [Course(front.scans, reference=front.truth, others=((sensor, rear.scans),)) for front, rear in _scanned()]


def scanners_merged(folder) -> list:
    """Return the scans of `scanners` merged as other programs need them: the latest of both, at each front one.

    One scan from the middle of the base has in each of 720 beams the nearest return of both; nothing is compensated.
    """
    courses = []
    for front, rear in _scanned():
        latest = np.searchsorted(rear.stamps, front.stamps, side='right') - 1
        chosen = np.flatnonzero(latest >= 0)
        scans = [merged(front.scans[k], rear.scans[latest[k]]) for k in chosen]
        base = compose(front.truth[chosen], FRONT.inverse().as_array()[None])
        courses.append(Course(scans, reference=base))
    return courses


def merged(front, rear) -> Scan:
    """Return the scan in the frame of the base that has the returns of both scanners, as if measured at once."""
    points = np.concatenate([pose.apply(scan.points[scan.valid]) for pose, scan in ((FRONT, front), (REAR, rear))])
    step = math.radians(0.5)
    beams = np.round((np.arctan2(points[:, 1], points[:, 0]) + math.pi) / step).astype(int) % 720
    ranges = np.full(720, np.inf)
    np.minimum.at(ranges, beams, np.hypot(points[:, 0], points[:, 1]))
    return Scan(front.stamp, ranges, ScanGeometry(-math.pi, step, 720, 0.05, 30.0))


@functools.cache
def _scanned() -> list:
    """Simulate both scanners in each world and seed; return pairs of `Simulation`, front and rear."""
    lidars = [Lidar(541, math.radians(-135.0), math.radians(0.5), 0.05, 30.0, rate, duration=0.75 / rate, noise=0.01,
                    resolution=0.01, mounting=mounting, phase=phase)
              for mounting, rate, phase in ((FRONT, 12.5, 0.0), (REAR, 15.0, 0.019))]
    pairs = []
    for make, seed in itertools.product((rooms, corridor, hall), SEEDS):
        world = make(seed=seed)
        path = follow(world.tour)
        path = Path(path.times[path.times < SCANNED], path.poses[path.times < SCANNED])
        pairs.append(tuple(simulate(world, path, lidar, seed + 100 * k) for k, lidar in enumerate(lidars)))
    return pairs


COURSES = {
    'intel': intel, 'aces': aces, 'urg04lx': urg04lx, 'lms511': lms511, 'rooms': simulated_rooms,
    'corridors': simulated_corridors, 'halls': simulated_halls, 'featureless': featureless, 'round': round_room,
    'chairs': chairs, 'trees': trees, 'lidars': lidars, 'leader': leader, 'far_noise': far_noise, 'losses': losses,
    'bursts': bursts,
    'outages': outages, 'scanner_front': scanner_front, 'scanner_rear': scanner_rear, 'scanners': scanners,
    'scanners_merged': scanners_merged, 'dropped': dropped, 'noise': noise, 'person': person, **hard_courses.COURSES,
    **moving_courses.COURSES, **misleading_courses.COURSES,
}
"""Name -> ``courses(folder)``: one course, or one for each seed."""
