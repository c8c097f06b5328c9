# SPDX-License-Identifier: Apache-2.0
"""Rotation in place: the turn rate of published twists against the truth between the middles of the scans."""
import numpy as np

from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.evaluation.methods import BenchmarkError

from ..report import Report
from . import seeds
from .hard_courses import SPIN_LIDARS, SPINS, spin

OURS = 'dbscan'
SETTLED = 5
"""Scans at the start that are not judged."""


def measure(args) -> Report:
    """Each lidar and motion; others publish no twist."""
    if args.method not in (None, [OURS]):
        raise BenchmarkError(f'spin needs twists, which only {OURS} has')
    courses, report = spin(seeds=seeds.SEEDS[:args.seeds]), Report()
    count = len(SPIN_LIDARS) * len(SPINS)
    names = [f'{lidar}_{motion}' for lidar in SPIN_LIDARS for motion in SPINS]
    rows = {name: figures([course.take(slice(args.limit)) for course in courses[k::count]])
            for k, name in enumerate(names)}
    report.add_courses('spin', rows, OURS)
    return report


def figures(courses) -> dict:
    """``rms_deg``: error of the turn rate [deg/s]; ``within``: the fraction within three standard deviations."""
    errors = np.concatenate([turn_rate_errors(course) for course in courses])
    return {'rms_deg': float(np.degrees(np.sqrt((errors[:, 0] ** 2).mean()))),
            'within': float((np.abs(errors[:, 0]) < 3.0 * errors[:, 1]).mean())}


def turn_rate_errors(course):
    """Errors ``(N, 2)`` of the published turn rates and their standard deviations [rad/s]."""
    odometry, errors = Odometry(), []
    heading = np.unwrap(course.reference[:, 2])
    half = 0.5 * course.scans[0].time_increment * course.scans[0].geometry.size
    for k, scan in enumerate(course.scans):
        update = odometry.process(scan)
        if k < SETTLED or k + 1 >= len(course.scans):
            continue
        middle = course.seconds[k] + half
        after, before = np.interp((middle, middle - update.interval), course.seconds, heading)
        off = wrap(update.twist[2] * update.interval - (after - before)) / update.interval
        errors.append((off, np.sqrt(update.twist_covariance[2, 2])))
    return np.array(errors).reshape(-1, 2)
