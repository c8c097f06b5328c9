# SPDX-License-Identifier: Apache-2.0
"""Two lidars, one with a wrong mounting or late stamps: error of the odometry, what is estimated, and who is named.

If the first one is wrong, wheels show it: the cases with ``wheels`` have simulated wheel odometry as external prior.
"""
import dataclasses
import math

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.calibration.comparisons import LidarComparisons
from dbscan_reg_ros.evaluation.metrics import evaluate

from ..bounds import at_most
from ..odometry.courses import scanners
from ..odometry.drift import OURS, SeveralLidars, follow
from ..report import Report
from . import first_wrong, silent
from .several import add_tables

LATE = 0.06
MOUNTING = SE2(0.04, -0.03, math.radians(3.0))
CASES = {'first alone': None, 'both right': (SE2(), 0.0), 'mounting 5 cm, 3 deg': (MOUNTING, 0.0),
         'stamps 60 ms': (SE2(), LATE)}
"""Case -> error of mounting and stamps [s] of the second lidar; None: it is not used."""
WHEELS = 'first, wheels:'
"""Begin of the names of the cases of `first_wrong`."""
EVERY = 3
"""One seed of three of each world."""
BOUNDS = {'mounting 5 cm, 3 deg': {'ratio': at_most(2.0), 'off_m': at_most(0.005), 'off_deg': at_most(0.1)},
          'stamps 60 ms': {'ratio': at_most(1.2), 'off_s': at_most(0.005)}}


def measure(args) -> Report:
    """Return the tables that `args` names, by default all."""
    report = Report()
    if not args.only or 'wrong' in args.only:
        _add_second_wrong(report, _courses(EVERY, args.limit))
    if not args.only or 'wheels' in args.only:
        wheels = first_wrong.measured(_courses(EVERY if args.limit else 1, args.limit))
        report.add_courses('first wrong, with wheels', {f'{WHEELS} {case}': row for case, row in wheels.items()}, OURS,
                           {f'{WHEELS} {case}': bounds for case, bounds in first_wrong.BOUNDS.items()})
    add_tables(report, args)
    if not args.only or 'silent' in args.only:
        silent.add_table(report, args)
    return report


def _courses(every, limit) -> list:
    """Return every so-manieth course of ``odometry --course scanners``, of each the first `limit` scans."""
    return [course.take(slice(limit)) for course in scanners(None)[::every]]


def _add_second_wrong(report, courses):
    """Add the table of a wrong second lidar: a row for each of the `CASES`."""
    rows = {}
    for case, error in CASES.items():
        rows[case] = _mean([_judged(course, error) for course in courses])
        rows[case]['ratio'] = rows[case]['rpe_5m_m'] / rows.get('both right', rows[case])['rpe_5m_m']
    report.add_courses('lidars', rows, OURS, BOUNDS)


def _judged(course, error) -> dict:
    """Error of the odometry over 5 m, and errors of what the second lidar is found to be; NaN: not observable."""
    if error is None:
        return _drift(course, follow(SeveralLidars(()), course, 'one lidar'))
    mounting, late = error
    (sensor, scans), = course.others
    wrong = dataclasses.replace(sensor, pose=sensor.pose @ mounting)
    scans = [dataclasses.replace(scan, stamp=scan.stamp + round(1e9 * late)) for scan in scans]
    course = dataclasses.replace(course, others=((wrong, scans),))
    found = _calibrated(course)
    off = sensor.pose.inverse() @ found.pose
    values = np.array([math.hypot(off.x, off.y), math.degrees(abs(off.theta)), abs(found.time_offset + late)])
    values[~found.observable[[0, 2, 3]]] = math.nan
    return _drift(course, follow(SeveralLidars(course.others), course, 'two lidars')) | dict(
        zip(('off_m', 'off_deg', 'off_s'), values.tolist(), strict=True))


def _calibrated(course):
    """Return the `RelativePose` of the second lidar, as ``calibrate`` estimates it."""
    comparisons = LidarComparisons(spacing=0.0, only=True, most=len(course.others[0][1]))
    follow(SeveralLidars(course.others, comparisons), course, 'calibration')
    return comparisons.lidars[course.others[0][0].name].judge()


def _drift(course, run) -> dict:
    metrics = evaluate(run.poses, course.stamps, None, course.reference)
    return {'rpe_5m_m': metrics['rpe_5m_mean_m'], 'rpe_5m_deg': metrics['rpe_5m_mean_deg']}


def _mean(rows) -> dict:
    """Means over the courses; of what is found the worst where it is observable."""
    result = {}
    for name in rows[0]:
        values = np.array([row[name] for row in rows])
        known = values[np.isfinite(values)]
        result[name] = float((known.max() if name.startswith('off') else known.mean()) if len(known) else math.nan)
    return result
