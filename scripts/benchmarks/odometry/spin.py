# SPDX-License-Identifier: Apache-2.0
"""Rotation in place: the turn rate of published twists against the truth between the middles of the scans."""
import numpy as np
from scipy.interpolate import CubicSpline

from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.evaluation.methods import BenchmarkError

from ..bounds import at_least, at_most
from ..report import Report
from . import seeds
from .hard_courses import SPIN_LIDARS, SPINS, spin

OURS = 'dbscan'
SETTLED = 5
"""Scans at the start that are not judged."""
BOUNDS = {'all': {'rms_deg': at_most(np.degrees(0.03)), 'within': at_least(0.97)}}


def measure(args) -> Report:
    """Each lidar and motion; others publish no twist."""
    if args.method not in (None, [OURS]):
        raise BenchmarkError(f'spin needs twists, which only {OURS} has')
    courses, report = spin(seeds=seeds.SEEDS[:args.seeds]), Report()
    count = len(SPIN_LIDARS) * len(SPINS)
    names = [f'{lidar}_{motion}' for lidar in SPIN_LIDARS for motion in SPINS]
    errors = {name: [turn_rate_errors(course.take(slice(args.limit))) for course in courses[k::count]]
              for k, name in enumerate(names)}
    errors['all'] = [each for course in errors.values() for each in course]
    rows = {name: figures(np.concatenate(each)) for name, each in errors.items()}
    report.add_courses('spin', rows, OURS, BOUNDS)
    return report


def figures(errors) -> dict:
    """``rms_deg``: error of the turn rate [deg/s]; ``within``: the fraction within three standard deviations."""
    return {'rms_deg': float(np.degrees(np.sqrt((errors[:, 0] ** 2).mean()))),
            'within': float((np.abs(errors[:, 0]) < 3.0 * errors[:, 1]).mean())}


def turn_rate_errors(course):
    """Errors ``(N, 2)`` of the published turn rates and their standard deviations [rad/s]."""
    odometry, errors = Odometry(), []
    heading = CubicSpline(course.seconds, np.unwrap(course.reference[:, 2]))
    half = 0.5 * course.scans[0].time_increment * course.scans[0].geometry.size
    for k, scan in enumerate(course.scans):
        update = odometry.process(scan)
        if k < SETTLED or k + 1 >= len(course.scans):
            continue
        middle = course.seconds[k] + half
        after, before = heading((middle, middle - update.interval))
        off = wrap(update.twist[2] * update.interval - (after - before)) / update.interval
        errors.append((off, np.sqrt(update.twist_covariance[2, 2])))
    return np.array(errors).reshape(-1, 2)
