# SPDX-License-Identifier: Apache-2.0
"""Arrays to a trajectory and a picture: python 08_arrays_to_a_picture.py, which makes the arrays in a simulation."""
import numpy as np

from dbscan_reg_ros import SE2, Odometry, OdometryUpdate, Prior, Scan, ScanError, write_tum
from dbscan_reg_ros.figures.plots import plot_map
from dbscan_reg_ros.simulation import demo

# What a driver of your own gives: points in any order [m], or ranges [m] and angles [rad]; a stamp [ns] for each scan.
measured = demo().scans[:200]
clouds = [(scan.points[scan.valid], scan.stamp) for scan in measured]

odometry = Odometry()
prior = Prior(SE2(), np.diag((0.2, 0.2, 0.1)) ** 2)  # of your own: the robot moves less than this between two scans
scans: list[Scan] = []
updates: list[OdometryUpdate] = []
for points, stamp in clouds:
    scan = Scan.from_points(points, stamp=stamp, range_min=0.1, range_max=30.0)
    try:
        updates.append(odometry.process(scan, prior if updates else None))
    except ScanError as error:  # too few returns: the next scan may be good again
        print(f'skipped at {stamp} ns: {error}')
        continue
    scans.append(scan)

write_tum('trajectory.tum', updates)
plot_map('map.pdf', scans, updates)
x, y, theta = updates[-1].pose
print(f'{len(updates)} poses, the last one x {x:.2f} m, y {y:.2f} m, theta {theta:.2f} rad')
