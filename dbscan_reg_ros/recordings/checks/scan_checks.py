# SPDX-License-Identifier: Apache-2.0
"""Checks of the fields of scans as a driver sends them; the node and the readers of recordings use the same checks."""
import math
import operator
from collections import deque
from dataclasses import dataclass
from itertools import islice
from typing import NamedTuple

import numpy as np

from ...core.scan import SECOND, in_nanoseconds
from ..stamps import equal
from .ranges import RangeChecks
from .scan_warnings import Kind, LastingWarnings, ScanWarning

FUTURE = 1.0
"""A stamp ahead of the clock by more than this [s] causes a warning."""
OTHER_SIZE = 0.1
"""Relative change of the number of beams that causes a warning: many lidars vary by a few beams."""
RECENT = 20
"""Number of latest stamps that are compared with one another."""
REPEATED = 3
"""Number of repeated stamps among the last `RECENT` stamps that causes a warning; messages sent twice cause fewer."""
RESTART = 2.0
"""A step back in time by more than this [s] causes a warning, even a single one."""
DISORDER = 4, 0.4
"""A warning is given if at least this number and this fraction of the last `RECENT` stamps go back; real drivers reach
0.25."""
CLOCK_STEP = 0.5, 5.0
"""The clock was set back if the stamps after a step back stay behind by more than this fraction of the period, and by
more than this number of standard deviations; stamps that jitter catch up."""
FEWEST_INTERVALS = 2
"""The duration of a scan is compared with the mean of at least this many intervals between stamps."""
TOO_LONG = 1.15, 2.0
"""A scan is too long if its duration exceeds (1.15 + 2 / n) times the mean of n intervals between stamps; 2 / n allows
for jitter."""
OTHER_UNIT = SECOND // 2000
"""Stamps are in another unit if all of the last ones increase by less than this [ns]: no lidar is that fast."""


class ScanFields(NamedTuple):
    """The fields of a LaserScan message as its driver states them; `stamp` in [ns], `ranges` ``(N,)`` in [m]."""

    stamp: int
    frame_id: str
    angle_min: float = 0.0
    angle_max: float = 0.0
    angle_increment: float = 1.0
    time_increment: float = 0.0
    range_min: float = 0.0
    range_max: float = math.inf
    ranges: object = (math.inf,)

    @classmethod
    def from_message(cls, message) -> 'ScanFields':
        """Return the fields of a LaserScan message; of a PointCloud2 message only those that both have."""
        header = message.header
        if not hasattr(message, 'ranges'):
            return cls(in_nanoseconds(header.stamp), header.frame_id)
        return cls(in_nanoseconds(header.stamp), header.frame_id, message.angle_min,
                   message.angle_max, message.angle_increment, message.time_increment, message.range_min,
                   message.range_max, message.ranges)

    @classmethod
    def from_scan(cls, scan) -> 'ScanFields':
        """Return the fields of a `Scan`."""
        g = scan.geometry
        return cls(scan.stamp, scan.frame_id, g.angle_min, g.angle_min + (g.size - 1) * g.angle_increment,
                   g.angle_increment, scan.time_increment, g.range_min, g.range_max, scan.ranges)


class ScanChecks:
    """Check scans one by one in the order in which they arrive."""

    def __init__(self):
        self._frame = self._size = None
        self._lasting = LastingWarnings().of
        self._ranges = RangeChecks()
        self.restart()

    def restart(self):
        """Clear the stored stamps, because time has started again."""
        self._stamps = deque(maxlen=RECENT + 1)

    def look(self, fields, now=0) -> list:
        """Return the `ScanWarning` objects about a scan, its `ScanFields`; `now` is the clock [ns], 0 without one.

        Scans with the same faulty value (angles, for instance) give the same warning object.
        """
        if not len(fields.ranges):
            return []
        found = (self._frames(fields), self._angles(fields), self._stamp(fields.stamp, now), self._clock(),
                 self._duration(fields), *self._ranges.look(fields))
        return [warning for warning in found if warning]

    def _frames(self, fields):
        frame, size = fields.frame_id, len(fields.ranges)
        old_frame, old_size = self._frame, self._size
        self._frame, self._size = frame, size
        if old_frame is None:
            return None
        if frame != old_frame and frame and old_frame:
            self.restart()
            return ScanWarning(Kind.FRAME, f'the scans change from the frame {old_frame!r} to {frame!r}: the odometry '
                               'is that of one laser; give each laser a topic of its own, and name them in scan_topics')
        if abs(size - old_size) > OTHER_SIZE * old_size:
            return ScanWarning(Kind.BEAMS, f'the scans change from {old_size} to {size} beams: expected about as many '
                               'in each scan; is a scan cut off, or do two lasers publish on one topic?')
        return None

    def _angles(self, fields):
        size, low, high, step = len(fields.ranges), fields.angle_min, fields.angle_max, fields.angle_increment
        if not step or not math.isfinite(low + step):
            return None
        last, near = low + (size - 1) * step, 1.5 * abs(step)
        if abs(high - last) <= near:
            return None
        wrapped = abs(math.remainder(high - last, 2.0 * math.pi)) <= near if math.isfinite(high) else False
        mirrored = abs(high - (low - (size - 1) * step)) <= near
        if (high - low) * step < 0.0 and (mirrored or not wrapped):
            return self._lasting(Kind.ANGLE_INCREMENT, (low, high, step), lambda: (
                f'angle_increment is {step:.6g} rad, but angle_max {high:.6g} rad lies '
                f'{"above" if high > low else "below"} angle_min {low:.6g} rad: expected the same sign; angle_max is '
                'ignored. If the map is a mirror image, the sign of angle_increment is wrong: mend the driver'))
        return self._lasting(Kind.ANGLE_MAX, (size, low, high, step), lambda: (
            f'angle_max is {high:.6g} rad, but {size} ranges, angle_min and angle_increment end at {last:.6g} rad; '
            'angle_max is ignored. If the map is bent, angle_increment is wrong: mend the driver'))

    def _stamp(self, stamp, now):
        last = self._stamps[-1] if self._stamps else stamp - 1
        if stamp == last == 0:
            return ScanWarning(Kind.STAMP_ZERO, 'the scans have no stamp (header.stamp is 0): no motion can be '
                               'estimated; the driver has to set it, in Python stamp=round(seconds * 1e9) of the Scan')
        if last - stamp > RESTART * SECOND:
            self.restart()
        self._stamps.append(stamp)
        if stamp < last and self._in_disorder():
            return ScanWarning(Kind.STAMP_BACK, f'the stamps of the scans go back by {(last - stamp) / SECOND:.3f} s, '
                               f'to {stamp / SECOND:.3f} s: expected stamps that increase; is a recording played in a '
                               'loop, was the clock set, or are there two drivers on one topic?')
        steps = len(self._stamps) - 1
        if (steps >= REPEATED and stamp - self._stamps[0] < steps * OTHER_UNIT
                and self._steps(lambda a, b: 0 < b - a < OTHER_UNIT) == steps):
            return ScanWarning(Kind.STAMP_UNIT, f'the stamps of the scans are {(stamp - self._stamps[0]) / steps:.6g} '
                               'ns apart: expected the time of each scan in nanoseconds; multiply microseconds by '
                               '1000, milliseconds by 1000000, and numbers of scans by the time between two scans')
        if equal(last, stamp) and self._steps(equal) >= REPEATED:
            return ScanWarning(Kind.STAMP_EQUAL, f'the stamps of the scans are equal ({stamp / SECOND:.3f} s), or less '
                               'than 0.1 ms apart: expected the time of each scan; without it there is no speed; the '
                               'driver has to set header.stamp for every scan')
        if now and stamp > now + FUTURE * SECOND:
            return ScanWarning(Kind.STAMP_FUTURE, f'the stamp of the scan is {(stamp - now) / SECOND:.1f} s in the '
                               'future; is the sensor\'s clock synchronised, and use_sim_time set where it should be?')
        return None

    def _clock(self):
        """Find a step back, half way through the recent stamps, after which they stay behind."""
        half = RECENT // 2
        if len(self._stamps) <= RECENT or self._stamps[half] >= self._stamps[half - 1]:
            return None
        times = np.array([stamp - self._stamps[0] for stamp in self._stamps]) / SECOND
        number = np.arange(len(times))
        model = np.column_stack((np.ones(len(times)), number, number >= half))
        (_, period, step), (squares,), *_ = np.linalg.lstsq(model, times, rcond=None)
        sigma = math.sqrt(squares / (len(times) - 3) * np.linalg.inv(model.T @ model)[2, 2])
        if period <= 0.0 or -step <= max(CLOCK_STEP[0] * period, CLOCK_STEP[1] * sigma):
            return None
        return ScanWarning(Kind.CLOCK_BACK, f'the clock of the stamps was set back by about {-step:.2g} s, at '
                           f'{self._stamps[half] / SECOND:.3f} s; expected stamps that increase. Odometry '
                           'continues, but tf has no newer transform until the stamps pass the old ones: synchronise '
                           'the clock before the drive, and correct it gradually')

    def _in_disorder(self):
        """Whether the last step back is a large one, or many stamps go back (`RESTART`, `DISORDER`)."""
        steps = len(self._stamps) - 1
        return not steps or self._steps(operator.gt) >= max(DISORDER[0], DISORDER[1] * steps)

    def _steps(self, relation):
        """Return the number of recent stamps that have this `relation` to the next stamp."""
        return sum(map(relation, self._stamps, islice(self._stamps, 1, None)))

    def _duration(self, fields):
        step = fields.time_increment
        if step == 0.0:
            return None
        if not 0.0 < step < math.inf:
            return self._lasting(Kind.TIME_INCREMENT, step, lambda: (
                f'time_increment is {step:.6g} s: expected the time from one beam to the next, or 0 where it is not '
                'known; mend the driver, or set odometry.deskew to false'))
        count = len(self._stamps) - 1
        if count < FEWEST_INTERVALS:
            return None
        interval = (self._stamps[-1] - self._stamps[0]) / count / SECOND
        lasts = (len(fields.ranges) - 1) * step
        if lasts <= interval * (TOO_LONG[0] + TOO_LONG[1] / count) or self._steps(operator.ge):
            return None
        return self._lasting(Kind.TIME_INCREMENT, step, lambda: (
            f'time_increment is {step:.6g} s, so that {len(fields.ranges)} beams last {lasts:.3g} s, but a scan comes '
            f'every {interval:.3g} s: expected a shorter time from one beam to the next, in seconds; mend the driver, '
            'or set odometry.deskew to false'))


@dataclass
class Sighting:
    """The first of `count` warnings of one kind, given for the scan with the number `first`, counted from 0."""

    warning: ScanWarning
    first: int
    count: int = 0

    def as_fields(self) -> dict:
        """Return the warning as a dictionary of plain values for a file."""
        return {'kind': self.warning.kind.value, 'text': self.warning.text, 'first_scan': self.first,
                'scans': self.count}


class ScanWatch:
    """Store the first warning of each kind that `ScanChecks` gives on a recording, and the number of each kind.

    `seen` scans were checked so far.
    """

    def __init__(self):
        self.seen = 0
        self._checks = ScanChecks()
        self._sightings = {}

    def look(self, fields, further=()):
        """Check the next scan, its `ScanFields`; `further` are other warnings about it."""
        for warning in (*self._checks.look(fields), *further):
            self._sightings.setdefault(warning.kind, Sighting(warning, self.seen)).count += 1
        self.seen += 1

    @property
    def sightings(self) -> list:
        """One `Sighting` for each kind of warning, in the order of the first warnings."""
        return list(self._sightings.values())

    def lines(self) -> list:
        """Return the `sightings` as text, one line for each kind of warning."""
        return [f'{s.warning.text} ({s.count} of {self.seen} scans, first scan {s.first})' for s in self.sightings]
