# SPDX-License-Identifier: Apache-2.0
"""Odometry of a recording: python 02_odometry_of_a_log.py [RECORDING], without one in a simulated building."""
import sys
from collections import Counter

from dbscan_reg_ros import Odometry, Parameters, ScanError, open_recording
from dbscan_reg_ros.simulation import demo

scans = open_recording(sys.argv[1]).scans() if sys.argv[1:] else demo().scans

# Parameters are changed by their full names, as in doc/parameters.md and in the YAML files.
parameters = Parameters().replace({'scan.range_max': 20.0})
odometry = Odometry(parameters)
statuses: Counter[str] = Counter()
for scan in scans:
    try:
        update = odometry.process(scan)
    except ScanError as error:  # too few returns: the next scan may be good again
        print(f'skipped at {scan.stamp} ns: {error}')
        continue
    statuses[update.status.name] += 1
    if update.number % 200 == 0:
        print(f'scan {update.number}: {update.pose.brief()}')
print(f'end: {update.pose.brief()}')
print(f'statuses: {dict(statuses)}')
