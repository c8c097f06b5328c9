# SPDX-License-Identifier: Apache-2.0
"""What the paper reports, measured: Table 1, Table 3, and its example of Figures 4 to 12."""
from dbscan_reg_ros.evaluation.methods import method

from ..report import Report
from . import steps, table1, table3

METHODS = 'icp', 'paper', 'dbscan'
RIVALS = 'icp', 'idc', 'icl', 'paper', 'dbscan'
"""Those of Table 1."""


def measure(args) -> Report:
    """Return a `Report`."""
    report = Report()
    rivals = [method(name) for name in args.method or RIVALS]
    methods = [method(name) for name in args.method or METHODS]
    table1.add(report, rivals, args.limit)
    table3.add_noise(report, args.data)
    table3.add_simulated(report, methods, args.limit)
    table3.add_recorded(report, methods, args)
    steps.add(report, methods, args.data)
    return report
