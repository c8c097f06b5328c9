"""CARMEN logs: one message a line; ``FLASER`` and ``ROBOTLASER1`` hold scans."""
import gzip
import math
import re
import zlib
from collections import Counter
from functools import cached_property, partial

import numpy as np

from ..core.errors import RecordingError, ScanError
from ..core.scan import Scan, ScanGeometry
from ..scan_checks import ScanFields, ScanWatch
from .decimals import nanoseconds, seconds
from .poses import corrected
from .recording import Record, Recording
from .trajectories import finite_numbers

SETTINGS = {'laser_range_min': '0.0', 'laser_time_increment': '0.0', 'laser_frame': 'laser'}
"""``PARAM`` lines that we write and read, with what holds without them [m, s]."""
FLASER_RANGE_MAX = 50.0
"""A ``FLASER`` reading of this or more [m] is a missing return (50, 81.83, 81.91)."""
FLASER_NO_RETURN = 81.83
"""What a missing return is written as [m]."""
UNLIMITED = 1e6
"""The maximum range [m] that is written for a sensor that names none."""
LONGEST_LINE = 2**22
"""Characters from which on a line is none, but something else that goes on without an end."""

_MESSAGE = re.compile(r'#|[A-Za-z_][A-Za-z_0-9]*\s|\s*$')


class CarmenLog(Recording):
    """A CARMEN log, plain or gzip.

    ``FLASER`` holds no angles: its n beams span 180 degrees from -90 on, 180 / n apart for even n and
    180 / (n - 1) for odd n. In ``ROBOTLASER1`` a reading of the maximum range is a missing return. The stamp is
    the ipc_timestamp, third from the end.
    """

    def __init__(self, path, topic=None):
        super().__init__(path)
        self._choose(Counter(kind for _, kind, _ in self._lines() if kind in _READERS), topic)
        first = next(self.scans(), None)
        if first is None:
            raise RecordingError(f'{self.path}: no readable scan; first problem: {self.problems[0]}')
        self.frame_id = first.frame_id

    def scans(self):
        for record in self.records():
            yield record.scan

    def records(self):
        geometry, settings, watch = None, dict(SETTINGS), ScanWatch()
        for number, kind, words in self._lines():
            try:
                if kind == 'PARAM':
                    _set(settings, words.split())
                elif kind == self.topic:
                    record = _READERS[kind](words.split(), settings, geometry)
                    geometry = record.scan.geometry
                    self._look(watch, ScanFields.from_scan(record.scan))
                    yield record
            except IndexError:
                self._report(f'{self.path.name}:{number}: damaged {kind} skipped: too few values')
            except (ScanError, ValueError) as error:
                self._report(f'{self.path.name}:{number}: damaged {kind} skipped: {error}')

    def stamps(self):
        return self._poses[0].tolist()

    def wheel_odometry(self):
        """The robot's poses; None where all of them are zero, as in the log of a sensor alone."""
        stamps, _, robot = self._poses
        return (stamps, robot) if robot.any() else None

    def truth(self):
        """The laser's poses where they were corrected, that is, do not simply move along with the odometry's."""
        stamps, laser, robot = self._poses
        return (stamps, laser) if corrected(laser, robot) else None

    @cached_property
    def _poses(self):
        """Stamps ``(N,)`` and poses of the laser and the robot ``(N, 3)``."""
        records = [(r.scan.stamp, r.laser_pose, r.robot_pose) for r in self.records()]
        stamps, laser, robot = zip(*records, strict=True)
        return np.array(stamps, dtype=np.int64), np.array(laser), np.array(robot)

    def _lines(self):
        """Line number, kind and words of every message that holds a scan or a setting."""
        number = 0
        open_text = gzip.open if _is_gzip(self.path) else open
        with open_text(self.path, 'rt', encoding='utf-8', errors='replace') as file:
            try:
                for number, line in enumerate(iter(partial(file.readline, LONGEST_LINE), ''), 1):
                    if len(line) == LONGEST_LINE:
                        self._report(f'{self.path.name}:{number}: cannot be read from here on: '
                                     f'the line has {LONGEST_LINE} characters or more')
                        return
                    kind, _, words = line.strip().partition(' ')
                    if kind in _READERS or kind == 'PARAM':
                        yield number, kind, words
                    elif not _MESSAGE.match(line):
                        self._report(f'{self.path.name}:{number}: not a CARMEN message, skipped')
            except (EOFError, OSError, zlib.error) as error:
                self._report(f'{self.path.name}:{number + 1}: cannot be read from here on: {error}')


def settings_of(scan) -> dict:
    """What only a ``PARAM`` line of a log can say of a scan: name -> text, as in `SETTINGS`."""
    values = scan.geometry.range_min, scan.time_increment, scan.frame_id or SETTINGS['laser_frame']
    return {name: str(value) if isinstance(value, str) else np.format_float_positional(np.float32(value), trim='0')
            for name, value in zip(SETTINGS, values, strict=True)}


def format_line(record) -> str:
    """A `Record` as a line of a log: ``FLASER`` where its angles are those of that message, else ``ROBOTLASER1``."""
    scan, geometry = record.scan, record.scan.geometry
    n = geometry.size
    is_flaser = n > 1 and geometry == ScanGeometry(*_flaser_angles(n), n, geometry.range_min, FLASER_RANGE_MAX)
    limit = _after(geometry.range_max) if math.isfinite(geometry.range_max) else UNLIMITED
    missing = np.isnan(scan.ranges) | (scan.ranges == np.inf)
    ranges = np.where(missing, np.float32(FLASER_NO_RETURN if is_flaser else limit), scan.ranges)
    readings = ' '.join([str(n), *ranges.astype(str)])
    poses = ' '.join(f'{value:.9f}' for pose in (record.laser_pose, record.robot_pose) for value in pose)
    stamp = seconds(scan.stamp)
    if is_flaser:
        return f'FLASER {readings} {poses} {stamp} log {stamp}'
    start, step = np.float32(geometry.angle_min), np.float32(geometry.angle_increment)
    return (f'ROBOTLASER1 0 {start!s} {step * (n - 1)!s} {step!s} {np.float32(limit)!s} 0.01 0 {readings} 0 {poses} '
            f'0 0 0 0 0 {stamp} log {stamp}')


def _read_flaser(words, settings, geometry):
    n = int(words[0])
    if n < 2 or len(words) != n + 10:
        raise ValueError(f'{len(words)} values where {n} readings need {n + 10}')
    ranges = _floats(words[1:n + 1])
    ranges[ranges >= FLASER_RANGE_MAX] = np.inf
    scan = _scan(words[-3], ranges, *_flaser_angles(n), FLASER_RANGE_MAX, settings, geometry)
    return Record(scan, _pose(words[n + 1:n + 4]), _pose(words[n + 4:n + 7]))


def _scan(stamp, ranges, start, step, range_max, settings, geometry):
    return Scan.from_fields(nanoseconds(stamp), ranges, start, step, float(settings['laser_range_min']), range_max,
                            float(settings['laser_time_increment']), settings['laser_frame'], geometry)


def _set(settings, words):
    """Take over a ``PARAM`` line that concerns the scans."""
    if words[0] in settings:
        if words[0] != 'laser_frame':
            float(words[1])
        settings[words[0]] = words[1]


def _flaser_angles(n):
    """First bearing and step [rad] of a ``FLASER`` with n beams."""
    return -math.pi / 2, math.pi / n if n % 2 == 0 else math.pi / (n - 1)


def _read_robotlaser(words, settings, geometry):
    n = int(words[7])
    remissions = int(words[8 + n]) if 0 < n < len(words) - 8 else 0
    poses = 9 + n + remissions
    if n < 1 or remissions < 0 or len(words) != poses + 14:
        raise ValueError(f'{len(words)} values where {n} readings and {remissions} remissions need {poses + 14}')
    start, view, step, limit = _floats(words[1:5])
    if not step and n > 1:
        step = view / (n - 1)
    ranges = _floats(words[8:8 + n])
    ranges[ranges == limit] = np.inf
    scan = _scan(words[-3], ranges, start, step, _before(limit), settings, geometry)
    return Record(scan, _pose(words[poses:poses + 3]), _pose(words[poses + 3:poses + 6]))


_READERS = {'FLASER': _read_flaser, 'ROBOTLASER1': _read_robotlaser}


def _before(limit):
    """The longest range below the maximum range of a log, which is no return: the `range_max` of a scan, which is."""
    return np.nextafter(np.float32(limit), np.float32(0.0))


def _after(range_max):
    """The inverse of `_before`."""
    return np.nextafter(np.float32(range_max), np.float32(np.inf))


def _floats(words):
    return np.array([float(word) for word in words])


def _pose(words):
    try:
        return finite_numbers(words)
    except ValueError as error:
        raise ValueError(f'pose {" ".join(words)}: {error}') from None


def _is_gzip(path):
    with open(path, 'rb') as file:
        return file.read(2) == b'\x1f\x8b'
