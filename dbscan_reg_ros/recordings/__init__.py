# SPDX-License-Identifier: Apache-2.0
"""Recordings on disk: scans, odometry and truth, whatever the format."""
from .recording import Recording, open_recording
from .trajectories import read_csv, read_tum, write_csv, write_tum
from .truth import (
    KnownMotion,
    Relations,
    data_folder,
    errors_of,
    find_recording,
    find_relations,
    interpolate,
    load_relations,
    true_poses,
)

__all__ = ['KnownMotion', 'Recording', 'Relations', 'data_folder', 'errors_of', 'find_recording', 'find_relations',
           'interpolate', 'load_relations', 'open_recording', 'read_csv', 'read_tum', 'true_poses', 'write_csv',
           'write_tum']
