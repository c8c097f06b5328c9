# SPDX-License-Identifier: Apache-2.0
"""People crossing close in front of a robot at rest or rotating in place, ten seeds."""
from ..report import Report
from . import seeds
from .hard_courses import passers


def measure(args) -> Report:
    """By ours and by others: no step between two scans called OK should be off by more than 0.1 m."""
    report = Report()
    groups = {'passers': passers(seeds=seeds.SEEDS[:args.seeds])}
    for method, rows in seeds.judged(args, groups, 'passers').items():
        report.add_courses('passers', rows, method)
    return report
