# SPDX-License-Identifier: Apache-2.0
"""Loops of Intel and of simulated tours, closed after the drive and on it: wrong ones, and errors with and without.

One wrong loop ruins a map, a missing one does not: none may be wrong, and closing loops may make no error larger.
"""
import dataclasses

import numpy as np

from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.evaluation.metrics import errors, evaluate
from dbscan_reg_ros.recordings.poses import relative
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
    odometry, loops, driving, poses, published, used = Odometry(), Loops(), Loops(every=False), [], [], []
    for number, scan in enumerate(course.scans):
        try:
            update = odometry.process(scan)
        except ScanError:
            continue
        loops.add(update)
        published.append(driving.add(update).pose.as_array())
        poses.append(update.pose.as_array())
        used.append(number)
    course = course.take(used)
    metrics = counts(loops.found, course.reference, wrong)
    metrics |= {f'driving_{key}': value for key, value in counts(driving.found, course.reference, wrong).items()}
    for name, each in (('open', poses), ('closed', loops.poses()), ('driving', published),
                       ('driving_end', driving.poses())):
        measured = evaluate(np.array(each), course.stamps, course.relations, course.reference)
        metrics |= {f'{name}_{key}': measured[key] for key in ('ate_m', 'relations_all_mean_m') if key in measured}
    return metrics


def counts(loops, reference, wrong) -> dict:
    """Count the `loops`, and those whose motion between the true poses `reference` (N, 3) is off by more."""
    if not loops:
        return {'loops_count': 0, 'wrong_count': 0}
    motions = np.array([loop.motion.as_array() for loop in loops])
    metres, degrees = errors(motions, relative(*reference[[loop.pair for loop in loops]].swapaxes(0, 1)))
    return {'loops_count': len(loops), 'worst_m': float(metres.max()), 'worst_deg': float(degrees.max()),
            'wrong_count': int(((metres > wrong[0]) | (degrees > wrong[1])).sum())}


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
