# SPDX-License-Identifier: Apache-2.0
"""Trajectory files of other programs, interpolated at the scans of a recording."""
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.errors import RecordingError
from ..recordings import interpolate, read_tum
from ..recordings.poses import compose
from .metrics import SAME_SCAN_WITHIN

LONGEST_GAP = 3.0
"""Longest gap over which poses are interpolated, as a multiple of the median interval of scans."""


@dataclass(frozen=True)
class GivenTrajectory:
    """A trajectory of another program.

    Attributes
    ----------
    path : Path
        File in TUM format, or a folder with a file ``RECORDING.tum`` for each recording.
    mounting : (float, float, float)
        Pose of the sensor in the frame of the body whose poses the file contains [m, m, rad].
    """

    path: Path
    mounting: tuple = (0.0, 0.0, 0.0)

    @classmethod
    def parse(cls, text) -> 'GivenTrajectory':
        """Parse an argument of the form ``FILE[@X,Y,DEG]``.

        Raises
        ------
        RecordingError
            When there is no such file or folder, or the mounting is not three numbers.
        """
        path, at, mounting = text.rpartition('@')
        if not at or Path(text).exists():
            path, mounting = text, '0,0,0'
        try:
            x, y, degrees = (float(word) for word in mounting.split(','))
            if not all(map(math.isfinite, (x, y, degrees))):
                raise ValueError
        except ValueError:
            raise RecordingError(f'{text}: expected FILE@X,Y,DEG with the pose of the sensor [m, m, deg]') from None
        if not Path(path).exists():
            raise RecordingError(f'{path}: no such trajectory; expected a file in TUM format, or a folder of these')
        return cls(Path(path), (x, y, math.radians(degrees)))

    def file(self, recording) -> Path:
        """Return the trajectory file for the recording with this name; raise RecordingError if there is none."""
        path = self.path / f'{recording}.tum' if self.path.is_dir() else self.path
        if not path.is_file():
            raise RecordingError(f'{path}: no such trajectory of the recording {recording}')
        return path

    def poses_at(self, recording, stamps):
        """Return the poses of the sensor at the scans of a recording.

        Parameters
        ----------
        recording : str
            Name of the recording.
        stamps : sequence of int (N,)
            Stamps of the scans [ns].

        Returns
        -------
        poses : (N, 3) float [m, m, rad]
            NaN if the trajectory has no pose at the stamp of a scan and no poses close before and after it.
        """
        stamps = np.asarray(stamps, dtype=np.int64)
        own, poses = read_tum(self.file(recording))
        if not len(own):
            return np.full((len(stamps), 3), np.nan)
        found = interpolate(own, compose(poses, np.broadcast_to(self.mounting, poses.shape)), stamps)
        own = np.unique(own)
        after = np.clip(np.searchsorted(own, stamps), 1, max(len(own) - 1, 1)) % len(own)
        before = np.maximum(after - 1, 0)
        nearest = np.minimum(np.abs(own[after] - stamps), np.abs(own[before] - stamps))
        longest = LONGEST_GAP * np.median(np.abs(np.diff(stamps))) if len(stamps) > 1 else 0.0
        found[(nearest >= SAME_SCAN_WITHIN) & (own[after] - own[before] > longest)] = np.nan
        return found
