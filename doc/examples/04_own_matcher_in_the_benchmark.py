# SPDX-License-Identifier: Apache-2.0
"""A matcher of your own beside ours: python 04_own_matcher_in_the_benchmark.py [RECORDING with truth or relations]."""
import sys

import numpy as np
from scipy.spatial import cKDTree

from dbscan_reg_ros import SE2, Status, open_recording
from dbscan_reg_ros.evaluation.baselines import Result, fit
from dbscan_reg_ros.evaluation.known_motion import errors_of
from dbscan_reg_ros.evaluation.methods import Method
from dbscan_reg_ros.evaluation.trackers import KeyFrames, tracker
from dbscan_reg_ros.simulation import demo
from dbscan_reg_ros.simulation.recording import SimulatedRecording


# A method prepares each scan once, then aligns pairs of them; KeyFrames makes an odometry of any method.
def align(reference: np.ndarray, current: np.ndarray, guess: SE2 | None = None, max_distance: float = 0.5) -> Result:
    """Return the pose of the current scan in the reference's frame, by point-to-point ICP."""
    tree, transform = cKDTree(reference), guess or SE2()
    for _ in range(20):
        distance, nearest = tree.query(transform.apply(current))
        transform = fit(reference[nearest[distance < max_distance]], current[distance < max_distance])
    return Result(transform, Status.OK)


recording = open_recording(sys.argv[1]) if sys.argv[1:] else SimulatedRecording('simulated', demo())
for odometry in tracker('dbscan'), KeyFrames(Method('own', lambda scan: scan.points[scan.valid], align)):
    errors = errors_of(recording, recording.stamps(), [odometry.process(s).pose.as_array() for s in recording.scans()])
    print(type(odometry).__name__, {name: round(each, 4) for name, each in errors.items() if '_mean_' in name})
