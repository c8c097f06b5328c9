# SPDX-License-Identifier: Apache-2.0
"""Checks of the fields of scans as a driver sends them; the node and the readers of recordings use the same checks."""
import math
import operator
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from itertools import islice
from typing import NamedTuple

import numpy as np

from ...core.errors import ScanError
from ...core.no_return import NoReturn
from ...core.scan import SECOND, in_nanoseconds
from ...robot.point_cloud import some_points
from ..stamps import equal


class Kind(Enum):
    """Field or fault of a scan that a `ScanWarning` reports."""

    FRAME = 'frame'
    BEAMS = 'beams'
    ANGLE_INCREMENT = 'angle_increment'
    ANGLE_MAX = 'angle_max'
    STAMP_ZERO = 'stamp_zero'
    STAMP_EQUAL = 'stamp_equal'
    STAMP_UNIT = 'stamp_unit'
    STAMP_BACK = 'stamp_back'
    CLOCK_BACK = 'clock_back'
    STAMP_FUTURE = 'stamp_future'
    TIME_INCREMENT = 'time_increment'
    MILLIMETRES = 'millimetres'
    CENTIMETRES = 'centimetres'
    RANGE_MAX = 'range_max'
    RANGE_MIN = 'range_min'
    MOUNTING = 'mounting'
    NO_RETURN = 'no_return'
    OPTICAL_FRAME = 'optical_frame'


BETWEEN_SCANS = Kind.BEAMS, Kind.STAMP_EQUAL, Kind.STAMP_UNIT, Kind.STAMP_BACK, Kind.CLOCK_BACK, Kind.TIME_INCREMENT
"""Faults that are found by comparing a scan with those before it."""


@dataclass(frozen=True, eq=False)
class ScanWarning:
    """A fault in the fields of a scan: `text` names the value, the expected one and the remedy."""

    kind: Kind
    text: str


class LastingWarnings:
    """Gives the same warning object for each scan with the same fault."""

    def __init__(self) -> None:
        self._said: dict[Kind, tuple[object, ScanWarning]] = {}

    def of(self, kind: Kind, key: object, text: Callable[[], str]) -> ScanWarning:
        """Return the last warning of this `kind` if it has the same `key`, else a new warning."""
        said = self._said.get(kind)
        if said is None or said[0] != key:
            said = self._said[kind] = key, ScanWarning(kind, text())
        return said[1]


TOO_LARGE = 100.0
"""Median range above which ranges are taken as millimetres or centimetres: in metres no scan exceeds it."""
BEYOND = 1.05
"""Ratio of the median range to `range_max` above which the difference is no rounding error."""
NEAREST = 0.05
"""Ranges below this [m] are codes: drivers state with them why a return is missing."""
SAME = 0.999
"""Ranges above this fraction of the greatest range are regarded as equal; several such ranges mean missing returns."""
SAMPLE, FEWEST = 256, 8
"""Approximate number of beams whose ranges are checked, and the minimum number of their returns for a warning."""
EVERY = 10
"""Units and limits are checked in this many scans at the start, then in every scan whose number is a multiple of it."""
UNITS = {1000: (Kind.MILLIMETRES, 'millimetres'), 100: (Kind.CENTIMETRES, 'centimetres')}
"""Number in a metre -> unit that ranges are sent in by mistake."""
ROOM = 0.5
"""The median range in the right unit is at least this [m]."""
STATED = 2.0, 500.0
"""The `range_max` that a driver states is between these [m]."""
STATED_MIN = 1.0
"""The `range_min` that a driver states is at most this [m]."""


class RangeChecks:
    """Check the ranges of scans one by one."""

    def __init__(self):
        self._seen = 0
        self._warnings = LastingWarnings()
        self._no_return = NoReturn()
        self._found = []

    def look(self, fields) -> list:
        """Return the warnings about the ranges of a scan, its `ScanFields`."""
        if self._seen < EVERY or self._seen % EVERY == 0:
            self._found = list(filter(None, [self._judge(fields)]))
        self._seen += 1
        return [*self._found, *self._codes(fields)]

    def _codes(self, fields):
        self._no_return.add(fields.ranges, fields.range_max, fields.angle_increment)
        value = self._no_return.known
        if value is None:
            return []
        return [self._warnings.of(Kind.NO_RETURN, value, lambda: (
            f'many beams have exactly the same largest range, {value:.6g} m, scan after scan: it is used as no return; '
            'expected inf for a beam without a return (REP-117): mend the driver, or leave it as it is'))]

    def _judge(self, fields):
        with np.errstate(invalid='ignore'):
            values = np.asarray(fields.ranges[::max(len(fields.ranges) // SAMPLE, 1)], dtype=float)
        values = np.sort(values[(values > NEAREST) & (values < math.inf)])
        missing = len(values) - np.searchsorted(values, SAME * values[-1]) if len(values) else 0
        if missing > 1:
            values = values[:-missing]
        if len(values) < FEWEST:
            return None
        median, low, high = float(values[len(values) // 2]), fields.range_min, fields.range_max
        limits, is_beyond = f'range_min is {low:.6g} m, range_max {high:.6g} m', 0.0 < BEYOND * high < median
        units = _units(values, low, high)
        if median > TOO_LARGE or (is_beyond and units == [100]):
            units = units or [1000]
            kind, names = UNITS[units[0]][0], ' or '.join(UNITS[unit][1] for unit in units)
            return self._warnings.of(kind, (low, high), lambda: (
                f'the ranges look like {names}: half of them are above {median:.6g}, {limits}; expected metres, all '
                f'three: have the driver divide by {" or ".join(map(str, units))}'))
        if low >= high > 0.0:
            kind = Kind.RANGE_MAX if is_beyond and median >= low else Kind.RANGE_MIN
            return self._warnings.of(kind, (low, high), lambda: (
                f'range_min is not below range_max: {limits}, and half of the ranges are above {median:.6g} m; '
                'expected most of them between; every return counts as missing now: mend the limits in the driver'))
        if is_beyond:
            return self._warnings.of(Kind.RANGE_MAX, high, lambda: (
                f'the ranges lie beyond range_max: half of them are above {median:.6g} m, {limits}; expected most of '
                'them between; ranges beyond range_max count as missing returns: mend range_max in the driver'))
        if median < low:
            return self._warnings.of(Kind.RANGE_MIN, low, lambda: (
                f'the ranges lie below range_min: half of them are below {median:.6g} m, {limits}; expected most of '
                'them between; ranges below range_min count as missing returns: mend range_min in the driver'))
        return None


def _units(values, low, high):
    """Return the `UNITS` in which sorted ranges ``(N,)`` that are no metres can be, by the limits that are stated."""
    near, median, far = values[[len(values) // 20, len(values) // 2, len(values) * 19 // 20]]
    found = []
    for unit in UNITS:
        fits = median >= ROOM * unit
        if 0.0 < high <= STATED[1]:
            fits &= far <= unit * high and near >= unit * low
        elif math.isfinite(high) and high > 0.0:
            fits &= STATED[0] * unit <= high <= STATED[1] * unit and low <= STATED_MIN * unit
        if fits:
            found.append(unit)
    return found


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


FEWEST_POINTS = 20
"""Fewest points of a message that are judged."""
ROOMS = 500.0, 3000.0
"""Below the first median distance points cannot be in millimetres, above the second not in centimetres: they would be
nearer than 0.5 m, or farther than 30 m."""
STEEP, NEARLY_ALL = 0.5, 0.95
"""The frame has the axes of a camera if this fraction of the points lies upwards of the sensor, steeper than this
slope; a lidar or a camera that looks ahead sees at least as much below itself."""


class CloudChecks:
    """Check the point clouds of one lidar one by one."""

    def __init__(self):
        self._warnings = LastingWarnings()

    def look(self, message, matrix) -> list:
        """Return the warnings about a PointCloud2 message; `matrix` transforms points to the base frame."""
        try:
            points = some_points(message)
        except ScanError:
            return []
        if len(points) < FEWEST_POINTS:
            return []
        median = float(np.median(np.linalg.norm(points, axis=1)))
        if median > TOO_LARGE:
            units = [unit for unit, fits in zip(UNITS, (median >= ROOMS[0], median <= ROOMS[1]), strict=True) if fits]
            kind, names = UNITS[units[0]][0], ' or '.join(UNITS[unit][1] for unit in units)
            return [self._warnings.of(kind, kind, lambda: (
                f'the points look like {names}: half of them are farther away than {median:.6g}; expected metres: have '
                f'the driver divide by {" or ".join(map(str, units))}'))]
        turned = points @ matrix[:3, :3].T
        if np.mean(turned[:, 2] > STEEP * np.hypot(turned[:, 0], turned[:, 1])) < NEARLY_ALL:
            return []
        frame = message.header.frame_id
        return [self._warnings.of(Kind.OPTICAL_FRAME, frame, lambda: (
            f'nearly all points lie above the sensor: they have the axes of a camera, z forward, but {frame!r} has z '
            'up; expected x forward, or a transform from base_link to the optical frame (roll -90 deg, yaw -90 deg): '
            'mend header.frame_id or the transform'))]
