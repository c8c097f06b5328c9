# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of the lines of a CARMEN log."""
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ...core.scan import Scan
from ...core.scan_geometry import ScanGeometry
from ..recording import Record
from ..stamps import SECOND, nanoseconds, seconds, to_float
from ..trajectories import finite_numbers

SETTINGS = {'laser_range_min': '0.0', 'laser_time_increment': '0.0', 'laser_frame': 'laser'}
"""Names of the ``PARAM`` lines that are read and written, and their default values [m, s]."""
FLASER_RANGE_MAX = 50.0
"""Maximum range [m] of ``FLASER`` and similar lines, which do not state it; greater readings mean a missing return."""
FLASER_NO_RETURN = 81.83
"""Reading [m] that is written for a missing return."""
UNLIMITED = 1e6
"""Maximum range [m] that is written for a sensor without a maximum range."""
ODOMETRY_VALUES = 9
"""Number of values of an ``ODOM`` line: pose, two velocities, acceleration, stamp, host, stamp of the logger."""
FEWEST_READINGS = 2
"""Minimum number of readings of a ``FLASER`` line for which its beam angles are defined."""
FIRST_STAMP, END_OF_STAMPS = -10**6 * SECOND, (2**32 + 10**6) * SECOND
"""Stamps [ns] between these can be corrected: those of 32-bit counters, and some negative ones."""


_geometry = lru_cache(maxsize=16)(ScanGeometry)


class Line(NamedTuple):
    """The data of a line of the log that contains a scan."""

    stamp: int
    """Stamp in the line, not corrected [ns]; see `stamps.mend`."""
    ranges: np.ndarray
    """Readings as written in the line, codes for missing returns included ``(N,)`` [m]."""
    missing: np.ndarray
    """Readings that mean a missing return in lines of this kind ``(N,)`` bool."""
    start: float
    step: float
    """Bearing of the first beam, and step from one beam to the next [rad]."""
    range_max: float
    """Readings beyond this are missing returns [m]."""
    laser_pose: tuple | None = None
    robot_pose: tuple | None = None
    """x [m], y [m], theta [rad]; None if the line has no poses."""

    def geometry(self, settings) -> ScanGeometry:
        """Return the geometry of the scan; raise ScanError if the angles are invalid."""
        return _geometry(self.start, self.step, len(self.ranges), float(settings['laser_range_min']), self.range_max)

    def scan(self, settings, geometry, stamp, no_return=None) -> Scan:
        """Return the scan with the stamp `stamp` [ns]; readings of `no_return` [m] or more are missing returns.

        The `geometry` of the last scan is used again if that of this scan is equal.
        """
        missing = self.missing if no_return is None else self.missing | (self.ranges >= no_return)
        ranges = np.where(missing, np.inf, self.ranges)
        return Scan(stamp, ranges, self.geometry(settings).reuse(geometry), float(settings['laser_time_increment']),
                    settings['laser_frame'])


def read_line(kind, words) -> Line:
    """Parse the `words` of a message of one of the `KINDS`.

    Raises a ValueError or IndexError when the line is damaged.
    """
    return KINDS[kind](words)


def read_odometry(words):
    """Parse an ``ODOM`` line: stamp [ns] and pose [m, m, rad]; raise ValueError or IndexError if it is damaged."""
    if len(words) != ODOMETRY_VALUES:
        raise ValueError(f'{len(words)} values where {ODOMETRY_VALUES} are needed')
    return _stamp(words[6]), _pose(words[:3])


def set_parameter(settings, words):
    """Update `settings` from the words of a ``PARAM`` line if it is one of the `SETTINGS`."""
    if words[0] in settings:
        if words[0] != 'laser_frame':
            to_float(words[1])
        settings[words[0]] = words[1]


def settings_of(scan) -> dict:
    """Return the settings of a scan for ``PARAM`` lines: name -> text, as in `SETTINGS`."""
    values = scan.geometry.range_min, scan.time_increment, scan.frame_id or SETTINGS['laser_frame']
    return {name: str(value) if isinstance(value, str) else np.format_float_positional(np.float32(value), trim='0')
            for name, value in zip(SETTINGS, values, strict=True)}


def format_line(record: Record) -> str:
    """Format a `Record` as a line of a log: ``FLASER`` if its angles fit that message, else ``ROBOTLASER1``."""
    scan, geometry = record.scan, record.scan.geometry
    n = geometry.size
    is_flaser = n > 1 and geometry == _flaser_geometry(n, geometry.range_min)
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


def _read_old(words, poses):
    """Parse ``FLASER`` and similar lines: number of readings, readings, `poses` poses, stamp, host, logger's stamp."""
    n = _count(words[0], FEWEST_READINGS)
    needed = n + 4 + 3 * poses
    if len(words) != needed:
        raise ValueError(f'{len(words)} values where {n} readings need {needed}')
    ranges = _floats(words[1:n + 1])
    return Line(_stamp(words[-3]), ranges, ranges >= FLASER_RANGE_MAX, *_flaser_angles(n), FLASER_RANGE_MAX,
                *(_pose(words[first:first + 3]) for first in range(n + 1, n + 1 + 3 * poses, 3)))


def _read_new(words, tail):
    """Parse ``RAWLASER`` or ``ROBOTLASER``: 7 values, readings, remissions, `tail` values, stamp, host, log stamp."""
    n = _count(words[7], 1)
    remissions = _count(words[8 + n]) if n < len(words) - 8 else 0
    rest = 9 + n + remissions
    if len(words) != rest + tail + 3:
        raise ValueError(f'{len(words)} values where {n} readings and {remissions} remissions need {rest + tail + 3}')
    start, view, step, limit = _floats(words[1:5])
    if not step and n > 1:
        step = view / (n - 1)
    poses = (_pose(words[first:first + 3]) for first in (rest, rest + 3)) if tail else ()
    ranges = _floats(words[8:8 + n])
    return Line(_stamp(words[-3]), ranges, ranges == limit, start, step, _before(limit), *poses)


KINDS = {kind: lambda words: _read_old(words, 2) for kind in ('FLASER', 'RLASER')}
KINDS |= {f'LASER{number}': lambda words: _read_old(words, 0) for number in (3, 4, 5)}
KINDS |= {f'ROBOTLASER{number}': lambda words: _read_new(words, 11) for number in range(1, 6)}
KINDS |= {f'RAWLASER{number}': lambda words: _read_new(words, 0) for number in range(1, 6)}
"""Name of a message with a scan -> the function that makes a `Line` from its words."""
FRONT = ('FLASER', 'ROBOTLASER1')
"""Messages of the front scanner, which is chosen if a log has several scanners."""


def _flaser_angles(n: int) -> tuple[float, float]:
    """Return the first bearing and the step [rad] of a ``FLASER`` scan with n beams."""
    return -math.pi / 2, math.pi / n if n % 2 == 0 else math.pi / (n - 1)


def _flaser_geometry(n: int, range_min: float) -> ScanGeometry:
    """Return the geometry of a ``FLASER`` scan with n beams and the smallest range `range_min` [m]."""
    start, step = _flaser_angles(n)
    return ScanGeometry(start, step, n, range_min, FLASER_RANGE_MAX)


def _before(limit):
    """Return the next float below the maximum range `limit` of a log: a reading of `limit` is a missing return."""
    return np.nextafter(np.float32(limit), np.float32(0.0))


def _after(range_max):
    """Return the maximum range to write to a log for the `range_max` of a scan: the next float above it."""
    return np.nextafter(np.float32(range_max), np.float32(np.inf))


def _stamp(word):
    return nanoseconds(word, FIRST_STAMP, END_OF_STAMPS)


def _count(word, fewest=0):
    if not word.isdecimal() or int(word) < fewest:
        raise ValueError(f'number of readings {word!r}: expected a whole number of at least {fewest}')
    return int(word)


def _floats(words):
    try:
        return np.fromiter(map(float, words), float, len(words))
    except ValueError:
        return np.array([to_float(word) for word in words])


def _pose(words):
    try:
        return tuple(finite_numbers(words))
    except ValueError as error:
        raise ValueError(f'pose {" ".join(words)}: {error}') from None
