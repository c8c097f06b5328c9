# SPDX-License-Identifier: Apache-2.0
"""Scans and wheels: python 03_own_prior.py [RECORDING with wheel odometry], without one in a simulated corridor."""
import sys

import numpy as np

from dbscan_reg_ros import SE2, Odometry, Prior, open_recording
from dbscan_reg_ros.recordings import interpolate
from dbscan_reg_ros.simulation import Lidar, corridor, follow, simulate, wheel_odometry

if sys.argv[1:]:
    recording = open_recording(sys.argv[1])
    wheels = recording.wheel_odometry() or sys.exit('no wheel odometry in this recording')
    scans = list(recording.scans())
else:
    world = corridor(doors=0)
    drive = simulate(world, follow(world.tour), Lidar(range_max=8.0))
    scans, wheels = drive.scans, wheel_odometry(drive.path)

# Any other source of the motion will do. The laser is taken to sit at the centre of the wheels here.
told = interpolate(*wheels, [scan.stamp for scan in scans])  # not finite before the first message and after the last
scans, told = [scan for scan, pose in zip(scans, told) if np.isfinite(pose).all()], told[np.isfinite(told).all(axis=1)]
poses = [SE2.from_array(pose) for pose in told]
sigma = np.diag((0.02, 0.02, 0.01))  # standard deviations of the motion between two scans [m, m, rad]
alone, fused = Odometry(), Odometry()
for k, scan in enumerate(scans):
    motion = poses[k - 1].inverse() @ poses[k]
    prior = Prior(motion, sigma @ sigma) if k else None
    ends = alone.process(scan).pose, fused.process(scan, prior).pose
print(f'scans alone      {ends[0].brief()}\nscans and wheels {ends[1].brief()}')
print(f'wheels alone     {(poses[0].inverse() @ poses[-1]).brief()}')
