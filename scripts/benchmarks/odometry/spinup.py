# SPDX-License-Identifier: Apache-2.0
"""A lidar that spins up: how long until the odometry tracks after a first scan that holds little."""
import numpy as np

from dbscan_reg_ros.core.registration.records import Status

from ..report import Report
from . import seeds
from .hard_courses import SPINUPS, spinup


def measure(args) -> Report:
    """Each way to spin up by ours and by others, median and worst of the seeds."""
    courses = spinup(seeds=seeds.SEEDS[:args.seeds])
    groups = {name: courses[k::len(SPINUPS)] for k, name in enumerate(SPINUPS)}
    report = Report()
    for method, rows in seeds.judged(args, groups, 'spinup', figures).items():
        report.add_courses('spinup', rows, method)
    return report


def figures(run) -> dict:
    """Metrics as `seeds.figures`, and those of failed scans.

    ``failed_count``: judged scans that are `FAILED`; ``late_s``: time from the first judged scan to the last of these.
    """
    failed = np.array([step.status is Status.FAILED for step in run.steps]) & run.course.judged
    seconds = run.course.seconds - run.course.seconds[np.argmax(run.course.judged)]
    return {'failed_count': int(failed.sum()), 'late_s': float(seconds[failed].max(initial=0.0))} | seeds.figures(run)
