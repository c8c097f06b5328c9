# SPDX-License-Identifier: Apache-2.0
"""Trajectory files of other programs, interpolated at the scans of a recording."""
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.errors import RecordingError
from ..recordings import read_tum
from ..recordings.poses import compose, repeated_stamps
from .matching import Matched, match


@dataclass(frozen=True)
class GivenTrajectory:
    """A trajectory of another program."""

    path: Path
    """File in TUM format, or a folder with a file ``RECORDING.tum`` for each recording."""
    mounting: tuple = (0.0, 0.0, 0.0)
    """(float, float, float): pose of the sensor in the frame of the body whose poses the file contains [m, m, rad]."""

    @classmethod
    def parse(cls, text) -> 'GivenTrajectory':
        """Parse an argument of the form ``FILE[@X,Y,DEG]``.

        Raises a RecordingError when there is no such file or folder, or the mounting is not three numbers.
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
            raise RecordingError(f'{path}: no such trajectory; expected a file in TUM format, or a folder of such '
                                 'files')
        return cls(Path(path), (x, y, math.radians(degrees)))

    def file(self, recording) -> Path:
        """Return the path of the trajectory file for the recording with this name."""
        return self.path / f'{recording}.tum' if self.path.is_dir() else self.path

    def missing(self, recordings) -> dict:
        """Return name -> trajectory file of those of the `recordings`, given by name, whose file does not exist."""
        return {name: file for name in recordings if not (file := self.file(name)).is_file()}

    def poses_at(self, recording, stamps) -> Matched:
        """Return the poses of the sensor at the `stamps` ``(N,)`` [ns] of the scans of the `recording` with this name.

        There are none if its trajectory file does not exist.
        """
        if self.missing([recording]):
            return Matched(np.full((len(stamps), 3), np.nan), f'no such trajectory: {self.file(recording)}')
        own, poses = read_tum(self.file(recording))
        mounted = compose(poses, np.broadcast_to(self.mounting, poses.shape))
        matched = match(own, mounted, np.asarray(stamps, dtype=np.int64))
        repeated = repeated_stamps(own, poses)
        return matched._replace(explanation=f'{matched.explanation}; {repeated}') if repeated else matched
