# SPDX-License-Identifier: Apache-2.0
"""Register two scans: python 01_two_scans.py [RECORDING], without one in a simulated building."""
import math
import sys
from itertools import islice

import numpy as np

from dbscan_reg_ros import Scan, open_recording, register
from dbscan_reg_ros.simulation import demo

scans = open_recording(sys.argv[1]).scans() if sys.argv[1:] else demo().scans
reference, *_, current = islice(scans, 20)

# Scans of a driver of your own: arrays of ranges [m] and angles [rad], and the stamp in nanoseconds.
current = Scan.from_ranges(current.ranges, current.geometry.bearings, stamp=current.stamp,
                           range_min=current.geometry.range_min, range_max=current.geometry.range_max)
print(current)

# No initial guess is needed. The result is the pose of the sensor at the current scan, in the frame of the reference.
result = register(reference, current)
sigma = np.sqrt(np.diag(result.covariance_in_reference))
motion = result.transform
print(f'x {motion.x:.3f} m, y {motion.y:.3f} m, theta {math.degrees(motion.theta):.2f} deg')
print(f'standard deviations {sigma[0]:.3f} m, {sigma[1]:.3f} m, {math.degrees(sigma[2]):.2f} deg')
print(f'status {result.status.name} {result.reason}'.rstrip())
