# SPDX-License-Identifier: Apache-2.0
"""What the paper reports, measured: Table 1, Table 3, Figure 4 on many scans, and its example of Figures 4 to 12."""
from dbscan_reg_ros.evaluation.methods import method

from ..report import Report
from . import figure4, steps, table1, table3

METHODS = 'icp', 'paper', 'dbscan'
RIVALS = 'icp', 'idc', 'icl', 'paper', 'dbscan'
"""Those of Table 1."""


TABLES = 'table1', 'table3', 'figure4', 'steps'


def measure(args) -> Report:
    """Return the tables that `args` names, by default all."""
    report, tables = Report(), args.only or TABLES
    rivals = [method(name) for name in args.method or RIVALS]
    methods = [method(name) for name in args.method or METHODS]
    if 'table1' in tables:
        table1.add(report, rivals, args.limit)
    if 'table3' in tables:
        table3.add_noise(report, args.data)
        table3.add_simulated(report, methods, args.limit)
        table3.add_recorded(report, methods, args)
    if 'figure4' in tables:
        figure4.add(report, methods, args)
    if 'steps' in tables:
        steps.add(report, methods, args.data)
    return report
