# SPDX-License-Identifier: Apache-2.0
"""Narrow fields of view: depth cameras of 57 to 90 deg and 16 to 640 beams through furnished rooms, ten seeds."""
from ..report import Report
from . import seeds
from .hard_courses import CAMERAS, narrow


def measure(args) -> Report:
    """Each camera by ours and by others, median and worst of the seeds."""
    chosen = seeds.SEEDS[:args.seeds]
    courses = narrow(seeds=chosen)
    groups = {name: courses[k::len(CAMERAS)] for k, name in enumerate(CAMERAS)} | {'all': courses}
    report = Report()
    for method, rows in seeds.judged(args, groups, 'narrow').items():
        report.add_courses('narrow', rows, method)
    return report
