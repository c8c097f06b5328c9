# SPDX-License-Identifier: Apache-2.0
"""Loop closing after a drive: wrong loops, and the error with and without, on Intel and on simulated tours.

One wrong loop ruins a map, a missing one does not: none may be wrong, and closing loops may make no error larger.
"""
import dataclasses

import numpy as np

from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.evaluation.metrics import errors, evaluate
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.replays.loops import Loops
from dbscan_reg_ros.simulation import Lidar, corridor, hall, rooms

from ..bounds import at_most
from ..intel import Intel
from ..odometry.course import Course, simulated
from ..report import Report

TOURS = {'rooms': (rooms, 4), 'halls': (hall, 3), 'corridors': (corridor, 3)}
"""Kind -> how a world is made, and number of worlds."""
SEED = 20
"""Of the first world of each kind: no world that the confidence was fitted to."""
LIDAR, SPEED = Lidar(rate=2.0), 1.0
WRONG = {'intel': (0.3, 5.0)}
"""Course -> errors [m], [deg] above which a loop is wrong; the truth of Intel is itself off by some centimetres."""
WRONG_SIMULATED = (0.1, 2.0)


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
    odometry, loops, poses, used = Odometry(), Loops(), [], []
    for number, scan in enumerate(course.scans):
        try:
            update = odometry.process(scan)
        except ScanError:
            continue
        loops.add(update)
        poses.append(update.pose.as_array())
        used.append(number)
    poses, course = np.array(poses), course.take(used)
    closed, pairs, graph = loops.close(poses, Parameters())
    metrics = {'loops_count': len(pairs), 'wrong_count': 0}
    if len(pairs):
        first, last = course.reference[pairs].swapaxes(0, 1)
        metres, degrees = errors(graph.constraints.loops.motions, relative(first, last))
        metrics |= {'wrong_count': int(((metres > wrong[0]) | (degrees > wrong[1])).sum()),
                    'worst_m': float(metres.max()), 'worst_deg': float(degrees.max())}
    for name, each in (('open', poses), ('closed', closed)):
        measured = evaluate(each, course.stamps, course.relations, course.reference)
        metrics |= {f'{name}_{key}': measured[key] for key in ('ate_m', 'relations_all_mean_m') if key in measured}
    return metrics


def measure(args) -> Report:
    """Intel and every tour; ``--limit N`` drives the first N scans of each."""
    report, rows, intel = Report(), {}, Intel.below(args.data)
    courses = {'intel': Course(intel.scans, reference=intel.reference, relations=intel.relations), **tours()}
    for name, course in courses.items():
        part = course if args.limit is None else course.take(slice(args.limit))
        rows[name] = judge(part, WRONG.get(name, WRONG_SIMULATED))
    report.add_courses('loops', rows, bounds={name: {'wrong_count': at_most(0)} for name in rows})
    return report
