# SPDX-License-Identifier: Apache-2.0
"""Trajectory files in TUM format (``timestamp x y z qx qy qz qw``) and CSV (``index,x,y,theta[,ms]``)."""
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.beams import check_stamp
from ..core.errors import ArgumentError, RecordingError
from ..core.geometry.mounting import MAX_TILT
from ..core.geometry.se2 import DOF, SE2
from ..paths import check_file
from .files import UNREADABLE, reason_of, replacing
from .poses import FARTHEST, PoseError, planar, possible
from .stamps import nanoseconds, seconds, to_float

if TYPE_CHECKING:
    from ..core.odometry.records import OdometryUpdate

TUM = 'timestamp x y z qx qy qz qw'
"""Columns of a file in TUM format."""
LEAST_TILT, FLATTER = math.radians(1.0), 10.0
"""Rotations that are tilted by more than 1 deg, and more than ten times as much as with w first, have w first."""


def write_tum(path: str | os.PathLike[str], stamps: 'Iterable[int] | Iterable[OdometryUpdate]',
              poses: ArrayLike | Sequence[SE2] | None = None) -> None:
    """Write a trajectory in TUM format; the file appears complete or not at all.

    Parameters
    ----------
    path : str or Path
    stamps : sequence of int (N,), or of OdometryUpdate
        Stamps of the poses [ns], written in seconds with all nine decimals. Updates of the odometry have their poses
        as well.
    poses : array_like (N, 3) or sequence of SE2
        x, y [m], theta [rad].

    Raises
    ------
    ScanError
        When a stamp is no whole number.
    ArgumentError
        When there is not one pose of three numbers for each stamp, or the stamps are missing.
    """
    given: list[Any] = list(stamps)
    if poses is None and all(hasattr(each, 'pose') for each in given):
        given, poses = [each.stamp for each in given], [each.pose for each in given]
    in_place_of_stamps = any(isinstance(each, SE2 | Sequence | np.ndarray) for each in given)
    if poses is None or in_place_of_stamps:
        found = 'poses in place of the stamps' if in_place_of_stamps else 'stamps without poses'
        raise ArgumentError(f'{found}; expected write_tum(path, stamps, poses), or updates of an Odometry')
    rows = np.asarray(poses, dtype=float)
    if rows.shape != (len(given), DOF) and rows.size + len(given):
        raise ArgumentError(f'poses of shape {rows.shape} for {len(given)} stamps; expected x, y [m] and theta [rad] '
                            f'for each, ({len(given)}, 3)')
    with replacing(path) as file:
        for stamp, (x, y, theta) in zip(map(check_stamp, given), rows, strict=True):
            file.write(f'{seconds(stamp)} {x:.9f} {y:.9f} 0 0 0 {math.sin(theta / 2):.12f} '
                       f'{math.cos(theta / 2):.12f}\n')


def read_tum(path):
    """Read a trajectory in TUM format: return stamps ``(N,)`` int64 [ns] and poses ``(N, 3)`` [m, m, rad].

    Raises
    ------
    RecordingError
        When the file cannot be read, a line does not hold eight numbers, or the poses are not those of a plane.
    """
    stamps, poses, quaternions = [], [], []
    for number, line in numbered_lines(path):
        try:
            stamp, x, y, _, *quaternion = stamped(line, TUM)
            poses.append(planar(x, y, quaternion))
        except (ValueError, PoseError) as error:
            raise RecordingError(f'{path}:{number}: expected {TUM}: {error}') from None
        stamps.append(stamp)
        quaternions.append(quaternion)
    if fault := _not_planar(np.array(quaternions).reshape(-1, 4)):
        raise RecordingError(f'{path}: expected {TUM}: {fault}')
    return np.array(stamps, dtype=np.int64), np.array(poses, dtype=float).reshape(-1, 3)


def _not_planar(quaternions) -> str:
    """Return why rotations ``(N, 4)`` (x, y, z, w) are not those of a robot on the ground; empty if they are.

    Rotations of which w comes first look like a roll instead of a yaw.
    """
    tilts = [2.0 * np.arcsin(np.minimum(np.hypot(quaternions[:, first], quaternions[:, first + 1]), 1.0))
             for first in (0, 1)]
    tilt, w_first = (float(each.max(initial=0.0)) for each in tilts)
    if tilt <= MAX_TILT and tilt <= max(LEAST_TILT, FLATTER * w_first):
        return ''
    what = 'does w come first?' if w_first < tilt else 'are they poses of a camera, or of another axis up?'
    return (f'the poses are tilted by up to {math.degrees(tilt):.0f} deg against the plane, with w first by '
            f'{math.degrees(w_first):.0f} deg: {what}')


def write_csv(path, poses, indices=None, ms=None):
    """Write poses ``(N, 3)`` as ``index,x,y,theta[,ms]``; the file appears complete or not at all.

    Parameters
    ----------
    indices : sequence of int (N,), optional
        Number of the scan of each pose in the recording, from 0; by default the poses are those of all scans.
    ms : sequence of float (N,), optional
        Time spent on each scan [ms].
    """
    poses = np.asarray(poses, dtype=float).reshape(-1, 3)
    with replacing(path) as file:
        file.write('index,x,y,theta' + (',ms' if ms is not None else '') + '\n')
        for row, (index, pose) in enumerate(zip(range(len(poses)) if indices is None else indices, poses, strict=True)):
            x, y, theta = pose.tolist()
            file.write(f'{index},{x!r},{y!r},{theta!r}' + (f',{ms[row]:.4f}' if ms is not None else '') + '\n')


def read_csv(path):
    """Return scan numbers ``(N,)`` and poses ``(N, 3)`` of a file with at least the columns index, x, y and theta.

    Raises
    ------
    RecordingError
        When the file cannot be read, a column is missing or a line does not hold numbers.
    """
    lines = numbered_lines(path)
    header = next(lines, (1, ''))[1].split(',')
    try:
        columns = [header.index(name) for name in ('index', 'x', 'y', 'theta')]
    except ValueError:
        raise RecordingError(f'{path}:1: expected the columns index,x,y,theta') from None
    rows = []
    for number, line in lines:
        words = line.split(',')
        try:
            rows.append(finite_numbers(words[column] for column in columns))
        except (ValueError, IndexError) as error:
            raise RecordingError(f'{path}:{number}: expected {len(header)} numbers: {error}') from None
    rows = np.array(rows, dtype=float).reshape(-1, 4)
    return rows[:, 0].astype(int), rows[:, 1:]


def finite_numbers(words) -> list:
    """Convert `words` to floats; raise ValueError if one is not a number, not finite or too large for a pose."""
    numbers = [to_float(word) for word in words]
    if not possible(numbers):
        wrong = next(number for number in numbers if not possible((number,)))
        raise ValueError(f'{wrong:g}: expected finite numbers below {FARTHEST:g}')
    return numbers


def stamped(line, columns, stamps=1) -> list:
    """Convert a line with these `columns` to its `stamps` [ns], followed by its finite numbers.

    Raises a ValueError when the line has another number of columns, or one that is not valid.
    """
    words = line.split()
    if len(words) != len(columns.split()):
        raise ValueError(f'{len(words)} columns')
    return [*map(nanoseconds, words[:stamps]), *finite_numbers(words[stamps:])]


def numbered_lines(path):
    """Return line number and text of each line of a small file that is neither empty nor a ``#`` comment.

    Raises a RecordingError when the file cannot be read.
    """
    check_file(path, RecordingError)
    try:
        lines = Path(path).read_text(encoding='utf-8-sig').splitlines()
    except UNREADABLE as error:
        raise RecordingError(f'{path}: cannot be read: {reason_of(error)}') from error
    return ((number, line.strip()) for number, line in enumerate(lines, 1)
            if line.strip() and not line.startswith('#'))
