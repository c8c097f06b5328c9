# SPDX-License-Identifier: Apache-2.0
"""Arrays to a trajectory, a picture and a log: python 08_arrays_to_a_picture.py, which simulates the arrays."""
from pathlib import Path

import numpy as np

from dbscan_reg_ros import SE2, Odometry, OdometryUpdate, Prior, Scan, ScanError, write_tum
from dbscan_reg_ros.figures.plots import plot_map
from dbscan_reg_ros.recordings.conversion import write_log
from dbscan_reg_ros.recordings.recording import Record
from dbscan_reg_ros.simulation import demo

# What a driver of your own gives: points in any order [m], or ranges [m] and angles [rad]; a stamp [ns] for each scan.
drive = demo()
measured = drive.scans[:200]
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
# For replay, compare and the other commands, with the true poses of the sensor, or zeros where they are not known.
nowhere = 0.0, 0.0, 0.0
write_log(Path('drive.log'), [Record(scan, SE2.from_array(pose).as_tuple(), nowhere)
                              for scan, pose in zip(measured, drive.truth, strict=False)])
x, y, theta = updates[-1].pose
print(f'{len(updates)} poses, the last one x {x:.2f} m, y {y:.2f} m, theta {theta:.2f} rad')
