# SPDX-License-Identifier: Apache-2.0
"""A box over the lidar: what is called OK and is wrong, and how long it takes to track again."""
import numpy as np

from dbscan_reg_ros.core.registration.records import Status

from ..report import Report
from . import seeds
from .hard_courses import COVERED, COVERED_LIDARS, covered


def measure(args) -> Report:
    """Each lidar by ours and by others, median and worst of the times and seeds."""
    courses, each = covered(seeds=seeds.SEEDS[:args.seeds]), len(COVERED)
    groups = {name: [course for k, course in enumerate(courses) if k // each % len(COVERED_LIDARS) == row]
              for row, name in enumerate(COVERED_LIDARS)}
    report = Report()
    for method, rows in seeds.judged(args, groups, 'covered', figures).items():
        report.add_courses('covered', rows, method)
    return report


def figures(run) -> dict:
    """As `seeds.figures`, and ``late_s``: from the first scan without the box to the first `OK` one."""
    course = run.course
    first = int(np.flatnonzero(~course.judged).max(initial=-1)) + 1
    ok = [k for k in range(first, len(run.steps)) if run.steps[k].status is Status.OK]
    late = course.seconds[ok[0] if ok else -1] - course.seconds[min(first, len(run.steps) - 1)]
    return {'late_s': float(late)} | seeds.figures(run)
