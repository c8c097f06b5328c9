# SPDX-License-Identifier: Apache-2.0
"""Ground truth of a recording, and the folder of the recordings."""
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import RecordingError
from ..core.geometry.array_types import FloatArray
from ..core.geometry.se2 import wrap
from .poses import repeated_stamps
from .trajectories import numbered_lines, read_csv, read_tum, stamped

RELATION = 't1 t2 x y z roll pitch yaw'
"""Columns of a file of relations."""
DATA_VARIABLE = 'DBSCAN_REG_DATA'


def data_folder(argument=None) -> Path:
    """Return the folder that holds ``intel/`` and the other public recordings.

    The folder is `argument` if it is given, else ``$DBSCAN_REG_DATA``, else ``../shared/data`` beside the project root.

    Raises
    ------
    RecordingError
        When there is no such folder.
    """
    project = Path(__file__).resolve().parents[2]
    folder = Path(argument or os.environ.get(DATA_VARIABLE) or project.parent / 'shared' / 'data')
    if not folder.is_dir():
        raise RecordingError(f'{folder}: no such folder of recordings; name it with --data or ${DATA_VARIABLE}')
    return folder


def find_recording(path, data=None) -> Path:
    """Return `path` if it exists or is absolute, else `path` below the data folder.

    Raises
    ------
    RecordingError
        When a relative `path` exists in neither, or the data folder that was named does not exist.
    """
    path = Path(path)
    if path.exists() or path.is_absolute():
        return path
    try:
        folder = data_folder(data)
    except RecordingError:
        if data or os.environ.get(DATA_VARIABLE):
            raise
        raise RecordingError(f'{path}: no such file here; name the folder of recordings that it is in with --data or '
                             f'${DATA_VARIABLE}') from None
    if not (folder / path).exists():
        raise RecordingError(f'{path}: no such file here or in the folder of recordings {folder}')
    return folder / path


class Relations(NamedTuple):
    """The R true motions between pairs of stamps.

    Attributes
    ----------
    stamps : (R, 2) int64 [ns]
        First and second stamp of each relation.
    motions : (R, 3) float [m, m, rad]
        The pose at the second stamp in the frame of the pose at the first.
    """

    stamps: np.ndarray
    motions: np.ndarray


def find_relations(recording):
    """Return the path of ``NAME.relations`` beside the recording ``NAME.log[.gz]``; None if there is no such file."""
    recording = Path(recording)
    path = recording.with_name(recording.name.removesuffix('.gz').removesuffix('.log') + '.relations')
    return path if path != recording and path.is_file() else None


def load_relations(path) -> Relations:
    """Read `Relations` from a file with lines ``t1 t2 x y z roll pitch yaw``.

    Raises
    ------
    RecordingError
        When the file cannot be read, holds no relation, or a line is not eight numbers.
    """
    stamps, motions = [], []
    for number, line in numbered_lines(path):
        try:
            first, second, x, y, _, _, _, yaw = stamped(line, RELATION, stamps=2)
        except ValueError as error:
            raise RecordingError(f'{path}:{number}: expected {RELATION}: {error}') from None
        stamps.append((first, second))
        motions.append((x, y, yaw))
    if not stamps:
        raise RecordingError(f'{path}: holds no relation')
    return Relations(np.array(stamps, dtype=np.int64), np.array(motions))


def interpolate(stamps: ArrayLike, poses: ArrayLike, at: ArrayLike) -> FloatArray:
    """Return poses ``(M, 3)`` at the times `at` ``(M,)`` [ns], interpolated linearly (headings over the shorter arc).

    Poses are NaN before the first and after the last of the `stamps` ``(N,)``, which need not be in order.
    """
    stamps, first = np.unique(np.asarray(stamps, dtype=np.int64), return_index=True)
    poses, at = np.asarray(poses, dtype=float)[first], np.asarray(at, dtype=np.int64)
    if len(stamps) == 0:
        return np.full((len(at), 3), np.nan)
    after = np.clip(np.searchsorted(stamps, at), 1, max(len(stamps) - 1, 1)) % len(stamps)
    before = np.maximum(after - 1, 0)
    span = np.maximum(stamps[after] - stamps[before], 1)
    share = ((at - stamps[before]) / span)[:, None]
    step = poses[after] - poses[before]
    step[:, 2] = wrap(step[:, 2])
    result = poses[before] + share * step
    result[:, 2] = wrap(result[:, 2])
    result[(at < stamps[0]) | (at > stamps[-1])] = np.nan
    return result


def truth_beside(recording) -> list[Path]:
    """Return the files with true poses or relations beside the recording at a path."""
    recording = Path(recording)
    files = [recording.with_name(name) for name in ('truth.tum', 'reference.csv')]
    return [*filter(Path.is_file, files), *filter(None, [find_relations(recording)])]


def true_poses(recording):
    """Return stamps ``(N,)`` [ns] and true poses ``(N, 3)`` [m, m, rad] of a recording's sensor, or None.

    The poses come from the recording; else from ``truth.tum`` beside it; else from ``reference.csv`` beside it, if that
    file has a pose for every scan.

    Raises
    ------
    RecordingError
        When a file beside the recording cannot be read.
    """
    truth, path = recording.truth(), recording.path.with_name('reference.csv')
    beside = recording.path.with_name('truth.tum')
    if truth is None and beside.is_file():
        truth = read_tum(beside)
    if truth is not None:
        return _noted(truth, recording)
    if not path.is_file():
        return None
    indices, poses = read_csv(path)
    stamps = np.array(recording.stamps(), dtype=np.int64)
    return (stamps, poses) if np.array_equal(indices, np.arange(len(stamps))) else None


def read_truth(path, recording):
    """Read stamps ``(N,)`` [ns] and true poses ``(N, 3)`` [m, m, rad] of a recording's sensor from a file.

    The file has the TUM format, or the columns of ``reference.csv``: index of the scan, x, y, theta. Raises a
    RecordingError when the file cannot be read, or an index is not that of a scan of the recording.
    """
    if ',' not in next(numbered_lines(path), (1, ''))[1]:
        return _noted(read_tum(path), recording)
    indices, poses = read_csv(path)
    stamps = np.array(recording.stamps(), dtype=np.int64)
    if len(indices) and not 0 <= indices.min() <= indices.max() < len(stamps):
        raise RecordingError(f'{path}: scan {indices.max()}; expected numbers below {len(stamps)}, the scans of '
                             f'{recording.path}')
    return stamps[indices], poses


def _noted(truth, recording):
    """Return the stamps and poses of the `truth`; note in the recording if stamps are repeated."""
    if repeated := repeated_stamps(*truth):
        recording.note(f'true poses: {repeated}')
    return truth
