"""CARMEN logs: one message a line; ``FLASER`` and ``ROBOTLASER1`` hold scans."""
import gzip
import math
import re
import zlib
from collections import Counter
from typing import NamedTuple

import numpy as np

from ..core.errors import RecordingError, ScanError
from ..core.scan import Scan
from .decimals import nanoseconds
from .poses import relative
from .recording import Recording

FRAME_ID = 'laser'
FLASER_RANGE_MAX = 50.0
"""A ``FLASER`` reading of this or more [m] is a missing return (50, 81.83, 81.91)."""

_MESSAGE = re.compile(r'#|[A-Za-z_][A-Za-z_0-9]*\s|\s*$')


class CarmenLog(Recording):
    """A CARMEN log, plain or gzip.

    ``FLASER`` holds no angles: its n beams span 180 degrees from -90 on, 180 / n apart for even n and
    180 / (n - 1) for odd n. The stamp is the ipc_timestamp, third from the end.
    """

    frame_id = FRAME_ID

    def __init__(self, path, topic=None):
        super().__init__(path)
        self._choose(Counter(kind for _, kind, _ in self._lines()), topic)
        if next(self._records(), None) is None:
            raise RecordingError(f'{self.path}: no readable scan; first problem: {self.problems[0]}')

    def scans(self):
        for record in self._records():
            yield record.scan

    def wheel_odometry(self):
        stamps, _, robot = self._poses()
        return stamps, robot

    def truth(self):
        """The laser's poses where they were corrected, that is, do not simply move along with the odometry's."""
        stamps, laser, robot = self._poses()
        offset = relative(robot, laser)
        return (stamps, laser) if np.abs(offset - offset[0]).max() > 1e-3 else None

    def _poses(self):
        records = [(r.scan.stamp, r.laser_pose, r.robot_pose) for r in self._records()]
        stamps, laser, robot = zip(*records, strict=True)
        return np.array(stamps, dtype=np.int64), np.array(laser), np.array(robot)

    def _records(self):
        geometry = None
        for number, kind, words in self._lines():
            if kind != self.topic:
                continue
            try:
                record = _READERS[kind](words.split(), geometry)
            except IndexError:
                self._report(f'{self.path.name}:{number}: damaged {kind} skipped: too few values')
                continue
            except (ScanError, ValueError) as error:
                self._report(f'{self.path.name}:{number}: damaged {kind} skipped: {error}')
                continue
            geometry = record.scan.geometry
            yield record

    def _lines(self):
        """Line number, kind and words of every message that holds a scan."""
        number = 0
        with (gzip.open if _is_gzip(self.path) else open)(self.path, 'rt', encoding='latin-1') as file:
            try:
                for number, line in enumerate(file, 1):
                    kind, _, words = line.strip().partition(' ')
                    if kind in _READERS:
                        yield number, kind, words
                    elif not _MESSAGE.match(line):
                        self._report(f'{self.path.name}:{number}: not a CARMEN message, skipped')
            except (EOFError, OSError, zlib.error) as error:
                self._report(f'{self.path.name}:{number + 1}: cannot be read from here on: {error}')


class _Record(NamedTuple):
    """What one line says; poses are x, y, theta."""

    scan: Scan
    laser_pose: list
    robot_pose: list


def _read_flaser(words, geometry):
    n = int(words[0])
    if n < 2 or len(words) != n + 10:
        raise ValueError(f'{len(words)} values where {n} readings need {n + 10}')
    step = math.pi / n if n % 2 == 0 else math.pi / (n - 1)
    scan = Scan.from_fields(nanoseconds(words[-3]), _ranges(words[1:n + 1], FLASER_RANGE_MAX), -math.pi / 2, step,
                            0.0, FLASER_RANGE_MAX, frame_id=FRAME_ID, geometry=geometry)
    return _Record(scan, _pose(words[n + 1:n + 4]), _pose(words[n + 4:n + 7]))


def _read_robotlaser(words, geometry):
    n = int(words[7])
    remissions = int(words[8 + n]) if 0 < n < len(words) - 8 else 0
    poses = 9 + n + remissions
    if n < 1 or remissions < 0 or len(words) != poses + 14:
        raise ValueError(f'{len(words)} values where {n} readings and {remissions} remissions need {poses + 14}')
    start, view, step, range_max = (float(word) for word in words[1:5])
    if not step and n > 1:
        step = view / (n - 1)
    scan = Scan.from_fields(nanoseconds(words[-3]), _ranges(words[8:8 + n], range_max), start, step,
                            0.0, range_max, frame_id=FRAME_ID, geometry=geometry)
    return _Record(scan, _pose(words[poses:poses + 3]), _pose(words[poses + 3:poses + 6]))


_READERS = {'FLASER': _read_flaser, 'ROBOTLASER1': _read_robotlaser}


def _ranges(words, range_max):
    """Readings [m], infinite where there was no return."""
    ranges = np.array([float(word) for word in words])
    return np.where(ranges >= range_max, np.inf, ranges) if range_max > 0.0 else ranges


def _pose(words):
    pose = [float(word) for word in words]
    if not all(map(math.isfinite, pose)):
        raise ValueError(f'pose {" ".join(words)} is not finite')
    return pose


def _is_gzip(path):
    with open(path, 'rb') as file:
        return file.read(2) == b'\x1f\x8b'
