# SPDX-License-Identifier: Apache-2.0
"""Choose the reader of a recording by its format, and open it; `bags.reading.open_reader` opens bags."""
import gzip
import os
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.errors import RecordingError
from ..paths import check_file
from .bags.bag_faults import kind_of, unpacking_advice
from .files import UNREADABLE, reason_of
from .recording import Recording

if TYPE_CHECKING:
    from .bags.clouds import CloudParameters


def open_recording(path: str | os.PathLike[str], topic: str | None = None,
                   point_clouds: 'CloudParameters | None' = None) -> Recording:
    """Return the recording at `path`: CARMEN log (plain or gzip), ROS 1 bag, ROS 2 bag (folder, sqlite3 or mcap file).

    Parameters
    ----------
    path : str or Path
    topic : str, optional
        The topic of the scans; in a CARMEN log the name of the message. Needed if several topics have scans.
    point_clouds : CloudParameters, optional
        How the point clouds of a bag become scans; without it only laser scans can be read.

    Raises
    ------
    RecordingError
        When `path` cannot be read, is empty, has no known format or no scan, or has several topics of scans and
        `topic` is not given.
    """
    path = Path(path)
    if is_bag(path):
        from .bags.bag import Bag
        return Bag(path, topic, point_clouds)
    from .carmen.log import CarmenLog
    return CarmenLog(path, topic)


def is_bag(path) -> bool:
    """Whether `path` is a bag; otherwise it may be a CARMEN log.

    Raises a RecordingError when `path` cannot be read, is empty, or is neither a bag nor a CARMEN log.
    """
    if path.is_dir():
        _check_folder(path)
        return True
    check_file(path, RecordingError)
    packed, start = _starts_of(path)
    if not start:
        raise RecordingError(f'{path}: the file is empty')
    kind = kind_of(start)
    if kind and packed == start:
        return True
    if kind or (advice := unpacking_advice(path, start)):
        raise RecordingError(unpacking_advice(path, packed) if kind else advice)
    if b'\0' in start:
        raise RecordingError(f'{path}: neither a CARMEN log nor a ROS bag')
    return False


def _check_folder(path):
    """Raise RecordingError if the folder `path` is no ROS 2 bag."""
    if not (path / 'metadata.yaml').exists():
        raise RecordingError(f'{path}: a folder without metadata.yaml is no ROS 2 bag; name a file in it, or have '
                             f'its metadata.yaml written: ros2 bag reindex {shlex.quote(str(path.absolute()))}')


def _starts_of(path, size=512):
    """Return the first bytes of a file, raw and (if it is gzip) unpacked; raise RecordingError if it is unreadable."""
    try:
        with open(path, 'rb') as file:
            start = file.read(size)
        if start.startswith(b'\x1f\x8b'):
            with gzip.open(path) as file:
                return start, file.read1(size)
    except UNREADABLE as error:
        raise RecordingError(f'{path}: cannot be read: {reason_of(error)}') from error
    return start, start
