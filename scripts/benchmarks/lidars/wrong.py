# SPDX-License-Identifier: Apache-2.0
"""Two lidars, one with a wrong mounting or late stamps: error of the odometry, what is estimated, and who is named.

A lidar is mounted or stamped wrongly more often than it fails: it has to be named before it has driven far, may not
spoil the odometry meanwhile, and nobody may be named where all is right.
"""
import dataclasses
import math

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.calibration.comparisons import LidarComparisons
from dbscan_reg_ros.evaluation.metrics import evaluate

from ..odometry.courses import FRONT, REAR, scanners
from ..odometry.drift import OURS, SeveralLidars, follow
from ..report import Report, at_least, at_most
from . import heights, silent
from .several import Watched, add_tables

LATE = 0.06
MOUNTING = SE2(0.04, -0.03, math.radians(3.0))
CASES = {'first alone': None, 'both right': (FRONT, REAR, 0.0), 'mounting 5 cm, 3 deg': (FRONT, REAR @ MOUNTING, 0.0),
         'first 5 cm, 3 deg': (FRONT @ MOUNTING, REAR, 0.0), 'stamps 60 ms': (FRONT, REAR, LATE)}
"""Case -> mountings of both lidars, as they are given, and delay of the stamps of the second one [s]; None: the second
one is not used."""
EVERY = 3
"""One seed of three of each world."""
NAMED = {'names_count': at_least(2), 'named_m': at_most(20.0)}
BOUNDS = {'both right': {'names_most_count': at_most(0)},
          'mounting 5 cm, 3 deg': {**NAMED, 'ratio': at_most(2.0), 'off_m': at_most(0.005), 'off_deg': at_most(0.1)},
          'first 5 cm, 3 deg': {**NAMED, 'ratio': at_most(2.0)},
          'stamps 60 ms': {**NAMED, 'ratio': at_most(1.2), 'off_s': at_most(0.005)}}


def measure(args) -> Report:
    """Return the tables that `args` names, by default all."""
    report = Report()
    if not args.only or 'wrong' in args.only:
        _add_wrong(report, [course.take(slice(args.limit)) for course in scanners(None)[::EVERY]])
    add_tables(report, args)
    if not args.only or 'silent' in args.only:
        silent.add_table(report, args)
    if not args.only or 'heights' in args.only:
        heights.add_table(report, args)
    return report


def _add_wrong(report, courses):
    """Add the table of a wrong lidar: a row for each of the `CASES`."""
    rows = {}
    for case, error in CASES.items():
        rows[case] = _mean([_judged(course, error) for course in courses])
        rows[case]['ratio'] = rows[case]['rpe_5m_m'] / rows.get('both right', rows[case])['rpe_5m_m']
    report.add_courses('lidars', rows, OURS, BOUNDS)


def _judged(course, given) -> dict:
    """Error of the odometry over 5 m, how many lidars are named and after which drive, and errors of what is estimated.

    NaN: not observable.
    """
    if given is None:
        return _drift(course, follow(SeveralLidars(()), course, 'one lidar'))
    first, second, late = given
    (sensor, scans), = course.others
    wrong = dataclasses.replace(sensor, pose=first.inverse() @ second)
    scans = [dataclasses.replace(scan, stamp=scan.stamp + round(1e9 * late)) for scan in scans]
    course = dataclasses.replace(course, others=((wrong, scans),))
    found = _calibrated(course)
    off, watched = sensor.pose.inverse() @ found.pose, Watched()
    values = np.array([math.hypot(off.x, off.y), math.degrees(abs(off.theta)), abs(found.time_offset + late)])
    values[~found.observable[[0, 2, 3]]] = math.nan
    return _drift(course, follow(SeveralLidars(course.others, watched), course, 'two lidars')) | {
        'names_count': watched.names, 'named_m': watched.named_m} | dict(
        zip(('off_m', 'off_deg', 'off_s'), values.tolist(), strict=True))


def _calibrated(course):
    """Return the `RelativePose` of the second lidar, as ``calibrate`` estimates it."""
    comparisons = LidarComparisons(spacing=0.0, only=True, most=len(course.others[0][1]))
    follow(SeveralLidars(course.others, comparisons), course, 'calibration')
    return comparisons.lidars[course.others[0][0].name].estimate


def _drift(course, run) -> dict:
    metrics = evaluate(run.poses, course.stamps, None, course.reference)
    return {'rpe_5m_m': metrics['rpe_5m_mean_m'], 'rpe_5m_deg': metrics['rpe_5m_mean_deg']}


def _mean(rows) -> dict:
    """Means over the courses; of what is found the worst where it is observable, of names the fewest and the most."""
    result = {}
    for name in rows[0]:
        values = np.array([row[name] for row in rows])
        known = values[np.isfinite(values)]
        result[name] = float((known.max() if name.startswith(('off', 'named')) else known.mean())
                             if len(known) else math.nan)
    if 'names_count' in result:
        counts = [row['names_count'] for row in rows]
        result |= {'names_count': min(counts), 'names_most_count': max(counts)}
    return result
