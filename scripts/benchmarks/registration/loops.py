# SPDX-License-Identifier: Apache-2.0
"""Loops of Intel and of simulated tours, closed after the drive and on it: wrong ones, and errors with and without.

One wrong loop ruins a map, a missing one does not: none may be wrong, and closing loops may make no error larger.
"""
import dataclasses

import numpy as np

from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.evaluation.metrics import errors, evaluate
from dbscan_reg_ros.places.mapper import Mapper
from dbscan_reg_ros.recordings.poses import compose, relative
from dbscan_reg_ros.replays.loops import Loops
from dbscan_reg_ros.simulation import Lidar, corridor, hall, rooms

from ..intel import Intel
from ..odometry.course import Course, simulated
from ..report import Report, at_most

TOURS = {'rooms': (rooms, 4), 'halls': (hall, 3), 'corridors': (corridor, 3)}
"""Kind -> how a world is made, and number of worlds."""
SEED = 20
"""Of the first world of each kind: no world that the confidence was fitted to."""
LIDAR, SPEED = Lidar(rate=2.0), 1.0
WRONG = {'intel': (0.3, 5.0)}
"""Course -> errors [m], [deg] above which a loop is wrong; the truth of Intel is itself off by some centimetres."""
WRONG_SIMULATED = (0.1, 2.0)
BOUNDS = {'intel': {'driving_end_relations_all_mean_m': at_most(0.02), 'driving_end_ate_m': at_most(0.058),
                    'driving_ate_m': at_most(0.075)}}
"""At the end of a drive as when it is closed afterwards; as published no worse than the odometry alone."""


def tours() -> dict:
    """Name -> `Course`: each world is driven through, back, and through once more."""
    found = {}
    for kind, (make, count) in TOURS.items():
        for seed in range(SEED, SEED + count):
            world = make(seed=seed)
            way = np.vstack((world.tour, world.tour[-2::-1], world.tour[1:]))
            found[f'{kind}_{seed}'] = simulated(dataclasses.replace(world, tour=way), LIDAR, seed, speed=SPEED)
    return found


def judge(course, wrong) -> dict:
    """Drive a `Course`, close its loops, and count those that are off by more than `wrong` ([m], [deg])."""
    odometry, loops, driving, poses, used = Odometry(), Loops(), Driving(), [], []
    for number, scan in enumerate(course.scans):
        try:
            update = odometry.process(scan)
        except ScanError:
            continue
        loops.add(update)
        driving.add(update)
        poses.append(update.pose.as_array())
        used.append(number)
    poses, course = np.array(poses), course.take(used)
    closed, pairs, graph = loops.close(poses, Parameters())
    metrics = counts(graph.constraints.loops.motions, course.reference[pairs], wrong)
    metrics |= driving.judge(course, wrong)
    for name, each in (('open', poses), ('closed', closed), ('driving', np.array(driving.published)),
                       ('driving_end', driving.final())):
        measured = evaluate(each, course.stamps, course.relations, course.reference)
        metrics |= {f'{name}_{key}': measured[key] for key in ('ate_m', 'relations_all_mean_m') if key in measured}
    return metrics


def counts(motions, true_poses, wrong, prefix='') -> dict:
    """Count the loops with these `motions` (L, 3), between pairs of `true_poses` (L, 2, 3), that are off by more."""
    if not len(motions):
        return {f'{prefix}loops_count': 0, f'{prefix}wrong_count': 0}
    metres, degrees = errors(motions, relative(*true_poses.swapaxes(0, 1)))
    return {f'{prefix}loops_count': len(motions), f'{prefix}worst_m': float(metres.max()),
            f'{prefix}wrong_count': int(((metres > wrong[0]) | (degrees > wrong[1])).sum()),
            f'{prefix}worst_deg': float(degrees.max())}


class Driving:
    """A map that is built on the drive.

    Attributes
    ----------
    published : list of (x, y, theta)
        Poses at the scans as they were known then.
    loops : list of (int, int, SE2)
        Numbers of two scans, and the pose of the second one in the frame of the first, where a place was seen again.
    """

    def __init__(self):
        self._mapper, self._anchors, self._scans = Mapper(), [], []
        self.published, self.loops = [], []

    def add(self, update):
        """Use the next `OdometryUpdate`."""
        self.published.append(self._mapper.process(update).pose.as_tuple())
        number, pose = self._mapper.anchor
        if number == len(self._scans):
            self._scans.append(len(self.published) - 1)
        elif number != self._anchors[-1][0]:
            self.loops.append((self._scans[number], len(self.published) - 1, pose @ update.pose))
        self._anchors.append((number, (pose @ update.pose).as_tuple()))

    def final(self):
        """Return the poses (N, 3) of all scans by the whole drive."""
        numbers, poses = zip(*self._anchors, strict=True)
        return compose(self._mapper.graph.poses[list(numbers)], np.array(poses))

    def judge(self, course, wrong) -> dict:
        """Count the loops, and those that are off by more than `wrong`."""
        pairs = np.array([pair for *pair, _ in self.loops], dtype=int).reshape(-1, 2)
        return counts(np.array([motion.as_array() for *_, motion in self.loops]), course.reference[pairs], wrong,
                      'driving_')


def measure(args) -> Report:
    """Intel and every tour; ``--limit N`` drives the first N scans of each."""
    report, rows, intel = Report(), {}, Intel.below(args.data)
    courses = {'intel': Course(intel.scans, reference=intel.reference, relations=intel.relations), **tours()}
    for name, course in courses.items():
        part = course if args.limit is None else course.take(slice(args.limit))
        rows[name] = judge(part, WRONG.get(name, WRONG_SIMULATED))
    report.add_courses('loops', rows, bounds={
        name: {'wrong_count': at_most(0), 'driving_wrong_count': at_most(0)} | BOUNDS.get(name, {}) for name in rows})
    return report
