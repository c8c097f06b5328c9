# SPDX-License-Identifier: Apache-2.0
"""Poses of a trajectory, also of the file of another program, at the scans of a recording, and which have none."""
import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.errors import RecordingError
from ..recordings import interpolate, read_tum
from ..recordings.poses import compose, repeated_stamps
from .metrics import LONGEST_GAP, SAME_SCAN_WITHIN


class Matched(NamedTuple):
    """Poses of a trajectory at the stamps of scans."""

    poses: np.ndarray
    """NaN for scans without a pose ``(N, 3)`` [m, m, rad]."""
    explanation: str
    """How many scans have a pose, how many have no pose, and the reasons."""
    interpolated: int = 0
    """Number of poses that are interpolated between two poses of the trajectory."""


def match(own, poses, stamps, sparse=False) -> Matched:
    """Find the poses of a trajectory at the stamps of scans.

    A scan gets the pose with the same stamp. If there is none, the pose is interpolated between the previous and the
    next pose, unless the time between them exceeds `LONGEST_GAP` median scan intervals. If the trajectory is `sparse`,
    it may also be `LONGEST_GAP` median intervals of its own poses.

    Parameters
    ----------
    own : (K,) int64 [ns]
        Stamps of the trajectory, in any order.
    poses : (K, 3) float [m, m, rad]
    stamps : (N,) int64 [ns]
        Stamps of the scans.
    sparse : bool
        Whether the poses of the trajectory may be farther apart than the scans.
    """
    own, stamps = np.asarray(own, dtype=np.int64), np.asarray(stamps, dtype=np.int64)
    count = len(stamps)
    if not len(own):
        return Matched(np.full((count, 3), np.nan), f'none of {count} scans has a pose: the trajectory is empty')
    first, last = own.min(), own.max()
    at = np.where((stamps > first - SAME_SCAN_WITHIN) & (stamps < last + SAME_SCAN_WITHIN),
                  np.clip(stamps, first, last), stamps)
    found = interpolate(own, poses, at)
    own = np.unique(own)
    after = np.clip(np.searchsorted(own, stamps), 1, max(len(own) - 1, 1)) % len(own)
    before = np.maximum(after - 1, 0)
    at_stamp = np.minimum(np.abs(own[after] - stamps), np.abs(own[before] - stamps)) < SAME_SCAN_WITHIN
    longest = LONGEST_GAP * max(_interval(stamps), _interval(own) if sparse else 0.0)
    in_gap = ~at_stamp & np.isfinite(found[:, 0]) & (own[after] - own[before] > longest)
    found[in_gap] = np.nan
    words = [f'{at_stamp.sum()} of {count} scans have the stamp of a pose']
    between = int(np.isfinite(found[:, 0]).sum() - at_stamp.sum())
    if between:
        words.append(f'{between} lie between two poses, and their pose is interpolated')
    reasons = [times] if (times := outside(own, at)) else []
    if in_gap.any():
        reasons.append(f'{in_gap.sum()} where successive poses are more than {1e-9 * longest:.3f} s apart')
    if reasons:
        words.append(f'{np.isnan(found[:, 0]).sum()} have no pose: {" and ".join(reasons)}')
    return Matched(found, '; '.join(words) + _other_clock(first, last, stamps), between)


def _interval(stamps) -> float:
    """Return the median interval of `stamps` [ns]; 0 for a single one."""
    return float(np.median(np.abs(np.diff(stamps)))) if len(stamps) > 1 else 0.0


def outside(own, stamps) -> str:
    """Describe how many of the `stamps` ``(N,)`` [ns] are before the first and after the last of `own` ``(K,)``."""
    if not len(own):
        return 'no stamp'
    first, last = own.min(), own.max()
    early, late = int((stamps < first).sum()), int((stamps > last).sum())
    return ' and '.join([*([f'{early} before the first pose, {1e-9 * first:.3f} s'] if early else []),
                         *([f'{late} after the last pose, {1e-9 * last:.3f} s'] if late else [])])


def _other_clock(first, last, stamps) -> str:
    """Return a hint if no scan lies within the time from `first` to `last` [ns]; else an empty string."""
    if not len(stamps) or ((stamps >= first - SAME_SCAN_WITHIN) & (stamps <= last + SAME_SCAN_WITHIN)).any():
        return ''
    return (f' (the stamps of the scans go from {1e-9 * stamps.min():.3f} to {1e-9 * stamps.max():.3f} s: expected '
            'these in the trajectory file, in seconds, not the numbers of the scans)')


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
