# SPDX-License-Identifier: Apache-2.0
"""Narrow fields of view, lidars under a box, lidars that spin up: how late the odometry tracks, ten seeds."""
import numpy as np

from dbscan_reg_ros.core.registration.records import Status

from ..report import Report
from . import seeds
from .hard_courses import CAMERAS, COVERED, COVERED_LIDARS, SPINUPS, covered, narrow, spinup


def measure(args) -> Report:
    """Each camera, lidar or way to spin up by ours and by others, median and worst of the seeds."""
    groups, judge = {'narrow': (cameras, seeds.figures), 'covered': (lidars, of_covered),
                     'spinup': (ways, of_spinup)}[args.benchmark]
    report = Report()
    for method, rows in seeds.judged(args, groups(seeds.SEEDS[:args.seeds]), args.benchmark, judge).items():
        report.add_courses(args.benchmark, rows, method)
    return report


def cameras(chosen) -> dict:
    """Name of each camera, and ``all`` -> its courses."""
    courses = narrow(seeds=chosen)
    return {name: courses[k::len(CAMERAS)] for k, name in enumerate(CAMERAS)} | {'all': courses}


def lidars(chosen) -> dict:
    """Name of each covered lidar -> its courses."""
    courses, each = covered(seeds=chosen), len(COVERED)
    return {name: [course for k, course in enumerate(courses) if k // each % len(COVERED_LIDARS) == row]
            for row, name in enumerate(COVERED_LIDARS)}


def ways(chosen) -> dict:
    """Name of each way to spin up -> its courses."""
    courses = spinup(seeds=chosen)
    return {name: courses[k::len(SPINUPS)] for k, name in enumerate(SPINUPS)}


def of_covered(run) -> dict:
    """As `seeds.figures`, and ``late_s``: from the first scan without the box to the first `OK` one."""
    course = run.course
    first = int(np.flatnonzero(~course.judged).max(initial=-1)) + 1
    ok = [k for k in range(first, len(run.steps)) if run.steps[k].status is Status.OK]
    late = course.seconds[ok[0] if ok else -1] - course.seconds[min(first, len(run.steps) - 1)]
    return {'late_s': float(late)} | seeds.figures(run)


def of_spinup(run) -> dict:
    """Metrics as `seeds.figures`, and those of failed scans.

    ``failed_count``: judged scans that are `FAILED`; ``late_s``: time from the first judged scan to the last of these.
    """
    failed = np.array([step.status is Status.FAILED for step in run.steps]) & run.course.judged
    seconds = run.course.seconds - run.course.seconds[np.argmax(run.course.judged)]
    return {'failed_count': int(failed.sum()), 'late_s': float(seconds[failed].max(initial=0.0))} | seeds.figures(run)
