# SPDX-License-Identifier: Apache-2.0
"""Passers, companions, swinging doors, a pillar, stops, a curve: errors over 1 m, and what was silently wrong."""
import numpy as np

from dbscan_reg_ros.evaluation.metrics import apart, errors
from dbscan_reg_ros.recordings.poses import relative

from ..bounds import at_most
from ..report import Report
from . import seeds
from .drift import pose_within
from .hard_courses import passers
from .moving_courses import COURSES as MOVING

COURSES = {'passers': passers, **MOVING}
BOUNDS = {name: {'silent_count': at_most(0), 'stretches_count': at_most(0)} for name in COURSES}


def measure(args) -> Report:
    """Return the course that is named like the benchmark, by ours and by others."""
    name, report = args.benchmark, Report()
    groups = {name: COURSES[name](seeds=seeds.SEEDS[:args.seeds])}
    for method, rows in seeds.judged(args, groups, name, figures).items():
        report.add_courses(name, rows, method, BOUNDS)
    return report


def figures(run) -> dict:
    """As `seeds.figures`, and ``over_1m_m``: the median error over 1 m; ``within`` as `drift.judge`."""
    reference = run.course.reference
    found, (first, last) = seeds.figures(run), apart(reference, 1.0)
    if len(first):
        metres, _ = errors(relative(run.poses[first], run.poses[last]), relative(reference[first], reference[last]))
        found = {'over_1m_m': float(np.median(metres))} | found
    if all(step.covariance is not None for step in run.steps):
        found['within'] = pose_within(run)
    return found
