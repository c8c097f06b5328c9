# SPDX-License-Identifier: Apache-2.0
"""Recordings on disk in any supported format: scans, wheel odometry and ground truth."""
from .opening import open_recording
from .recording import Recording
from .trajectories import read_csv, read_tum, write_csv, write_tum
from .truth import Relations, data_folder, find_recording, find_relations, interpolate, load_relations, true_poses

__all__ = ['Recording', 'Relations', 'data_folder', 'find_recording', 'find_relations',
           'interpolate', 'load_relations', 'open_recording', 'read_csv', 'read_tum', 'true_poses', 'write_csv',
           'write_tum']
