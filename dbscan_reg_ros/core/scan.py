# SPDX-License-Identifier: Apache-2.0
"""Laser scans as a LaserScan message can hold them, and their geometry (Eq. 1-2)."""
import array
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from .beams import LaserScanMessage, check_angles, check_numbers, check_stamp
from .errors import ScanError

MAX_BEAMS = 100_000
MAX_RANGE = 100_000.0
"""What is farther [m] is no return, whatever the sensor says of its range."""
SECOND = 1_000_000_000
UNIFORM_WITHIN = 0.02
"""Beams this close to equally spaced ones, as a fraction of their step, are stored as equally spaced."""


@dataclass(frozen=True)
class ScanGeometry:
    """Where the beams of a scan point, and which ranges count.

    Two geometries are equal when their beams point the same way, so one object (with its cached
    sines and cosines) can serve all scans of a sensor.

    Parameters
    ----------
    angle_min : float
        Bearing of beam 0 [rad], rounded to float32.
    angle_increment : float
        Step from one beam to the next [rad], rounded to float32; negative for clockwise lidars.
    size : int
        Number of beams N.
    range_min, range_max : float
        A return counts when ``range_min <= range <= range_max`` [m], rounded to float32.
        A `range_max` of 0 or less, or one that is not finite, means "no limit".
    bearings_given : tuple of float, optional
        One bearing [rad] for each beam where they are not uniform (a moved or deskewed scan).

    Raises
    ------
    ScanError
        When an angle is not finite, the increment is 0, or the number of beams is out of range.
    """

    angle_min: float
    angle_increment: float
    size: int
    range_min: float = 0.0
    range_max: float = math.inf
    bearings_given: tuple[float, ...] | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        names = 'angle_min', 'angle_increment', 'range_min', 'range_max'
        for name, value in zip(names, _single(*(getattr(self, name) for name in names))):
            object.__setattr__(self, name, value)
        if not (math.isfinite(self.angle_min) and math.isfinite(self.angle_increment)):
            raise ScanError(f'angle_min {self.angle_min} and angle_increment {self.angle_increment} must be finite')
        if self.angle_increment == 0.0:
            raise ScanError('angle_increment is 0: the driver must say how far apart its beams are')
        if not 1 <= self.size <= MAX_BEAMS:
            raise ScanError(f'a scan of {self.size} beams; expected 1 to {MAX_BEAMS}')
        if self.bearings_given is None and abs(self.angle_increment) * (self.size - 1) > 4.0 * math.pi:
            raise ScanError(f'{self.size} beams {self.angle_increment} rad apart go round more than twice; '
                            'angles are in radians')
        if math.isnan(self.range_min):
            object.__setattr__(self, 'range_min', 0.0)
        if not self.range_max > 0.0:
            object.__setattr__(self, 'range_max', math.inf)
        if self.bearings_given is not None and len(self.bearings_given) != self.size:
            raise ScanError(f'{len(self.bearings_given)} bearings for {self.size} beams')

    @classmethod
    def from_bearings(cls, bearings: npt.ArrayLike, range_min: float = 0.0, range_max: float = math.inf,
                      angle_increment: float | None = None) -> 'ScanGeometry':
        """Geometry of a scan whose bearings ``(N,)`` [rad] are given one by one, in beam order.

        `angle_increment` is that of the sensor: its sign says on which side of a surface the sensor stood. When it is
        not given, the beams are taken as counter-clockwise and as far apart as most bearings are.
        """
        bearings = np.asarray(bearings, dtype=np.float32).astype(float)
        if bearings.ndim != 1 or not len(bearings) or not np.isfinite(bearings).all():
            raise ScanError('bearings must be one finite number for each beam')
        if angle_increment is None:
            steps = np.abs(np.remainder(np.diff(bearings) + math.pi, 2.0 * math.pi) - math.pi)
            angle_increment = (float(np.median(steps)) or float(steps.mean())) if len(steps) else 1.0
            angle_increment = angle_increment or 1e-3
        return cls(float(bearings[0]), angle_increment, len(bearings), range_min, range_max,
                   tuple(bearings.tolist()))

    @classmethod
    def from_angles(cls, angles: np.ndarray, range_min: float = 0.0, range_max: float = math.inf) -> 'ScanGeometry':
        """Geometry of a scan with about equally spaced beams at `angles` ``(N,)`` [rad], in beam order.

        Raises
        ------
        ScanError
            When the angles are not finite, not in order, or not about equally spaced.
        """
        bearings, step = check_angles(angles)
        size = len(bearings)
        uniform = cls(float(bearings[0]), float(bearings[-1] - bearings[0]) / (size - 1), size, range_min, range_max)
        error = bearings - bearings[0] - uniform.angle_increment * np.arange(size)
        if np.abs(error).max() <= UNIFORM_WITHIN * abs(step):
            return uniform
        return cls.from_bearings(bearings, range_min, range_max, step)

    @cached_property
    def bearings(self) -> np.ndarray:
        """``(N,)`` bearing of each beam [rad] (Eq. 1)."""
        if self.bearings_given is not None:
            return _frozen(np.array(self.bearings_given))
        return _frozen(self.angle_min + self.angle_increment * np.arange(self.size))

    @property
    def closed(self) -> bool:
        """Whether the beams go all the way round."""
        return abs(self.angle_increment) * (self.size + 1) > 2.0 * math.pi

    @cached_property
    def directions(self) -> np.ndarray:
        """``(N, 2)`` unit vector along each beam."""
        return _frozen(np.stack((np.cos(self.bearings), np.sin(self.bearings)), axis=1))


@dataclass(frozen=True, eq=False)
class Scan:
    """One sweep of a 2D lidar, immutable; the fields of a LaserScan that matter here.

    Parameters
    ----------
    stamp : int
        Time of the first beam [ns].
    ranges : array_like (N,)
        Measured ranges [m], rounded to float32; `inf`, `nan`, 0, negative values and values outside the
        geometry's limits are beams with no return (REP-117).
    geometry : ScanGeometry
    time_increment : float
        Time from one beam to the next [s]; 0 where unknown.
    frame_id : str
        The sensor's coordinate frame.

    Raises
    ------
    ScanError
        When the stamp is no whole number, a range is no number, or the number of ranges is not that of the geometry.
    """

    stamp: int
    ranges: np.ndarray
    geometry: ScanGeometry
    time_increment: float = 0.0
    frame_id: str = ''

    def __post_init__(self) -> None:
        object.__setattr__(self, 'stamp', check_stamp(self.stamp))
        with np.errstate(over='ignore'):
            ranges = check_numbers('ranges', self.ranges, np.float32)
        if len(ranges) != self.geometry.size:
            raise ScanError(f'{len(ranges)} ranges for {self.geometry.size} beams')
        object.__setattr__(self, 'ranges', _frozen(ranges))
        increment, = _single(self.time_increment)
        object.__setattr__(self, 'time_increment', increment if math.isfinite(increment) else 0.0)

    def __repr__(self) -> str:
        first, last = np.degrees(self.geometry.bearings[[0, -1]])
        returns = self.ranges[self.valid]
        reach = f' at {returns.min():.2f} to {returns.max():.2f} m' if len(returns) else ''
        return (f'Scan({self.geometry.size} beams from {first:.1f} to {last:.1f} deg, {len(returns)} returns{reach}, '
                f'stamp {self.stamp} ns)')

    @cached_property
    def valid(self) -> np.ndarray:
        """``(N,)`` bool: beams with a return between `range_min` and `range_max`."""
        ranges, geometry = self.ranges, self.geometry
        with np.errstate(invalid='ignore'):
            ok = (ranges > 0.0) & (ranges >= np.float32(geometry.range_min))
            ok &= ranges <= np.float32(min(geometry.range_max, MAX_RANGE))
        return _frozen(ok)

    @cached_property
    def points(self) -> np.ndarray:
        """``(N, 2)`` Cartesian points [m] in the sensor's frame (Eq. 2); not finite without a return."""
        ranges = np.where(self.valid, self.ranges.astype(float), np.nan)
        return _frozen(ranges[:, None] * self.geometry.directions)

    @classmethod
    def from_ranges(cls, ranges: npt.ArrayLike, angles: npt.ArrayLike, *, stamp: int = 0, range_min: float = 0.0,
                    range_max: float = math.inf, time_increment: float = 0.0) -> 'Scan':
        """Make a scan from arrays.

        Parameters
        ----------
        ranges : array_like (N,)
            Measured ranges [m], one for each beam; `inf`, `nan` or masked for a beam without a return.
        angles : array_like (N,)
            Bearing of each beam [rad], in the order of the beams, counter-clockwise or clockwise. A jump from pi to -pi
            is allowed.
        stamp : int
            Time of the first beam [ns].
        range_min, range_max : float
            Ranges outside of these [m] are no returns.
        time_increment : float
            Time from one beam to the next [s]; 0 where unknown.

        Raises
        ------
        ScanError
            When the arrays differ in shape or hold anything but numbers, when the angles are not finite, not in
            order, or not about equally spaced, or when the stamp is no whole number.
        """
        if isinstance(ranges, np.ma.MaskedArray):
            ranges = np.ma.filled(ranges.astype(float), np.nan)
        distances, bearings = check_numbers('ranges', ranges, float), check_numbers('angles', angles, float)
        if len(distances) != len(bearings):
            raise ScanError(f'{len(distances)} ranges for {len(bearings)} angles: expected one angle for each range')
        return cls(stamp, distances, ScanGeometry.from_angles(bearings, range_min, range_max), time_increment)

    @classmethod
    def from_fields(cls, stamp: int, ranges: Sequence[float] | np.ndarray, angle_min: float, angle_increment: float,
                    range_min: float = 0.0, range_max: float = math.inf, time_increment: float = 0.0,
                    frame_id: str = '', geometry: ScanGeometry | None = None) -> 'Scan':
        """A scan from plain LaserScan fields, wherever they come from.

        Parameters
        ----------
        geometry : ScanGeometry, optional
            That of the scan before: kept, with what it has cached, when this scan's is equal.
        """
        made = ScanGeometry(angle_min, angle_increment, len(ranges), range_min, range_max)
        kept = geometry if geometry == made else made
        return cls(stamp, np.asarray(ranges), kept, time_increment, frame_id)

    @classmethod
    def from_message(cls, message: LaserScanMessage, geometry: ScanGeometry | None = None, upside_down: bool = False,
                     turn: float = 0.0) -> 'Scan':
        """A scan from any object with the fields of a LaserScan message: rclpy's, or a bag reader's.

        The beams are counted in `ranges`; `angle_max`, which many drivers get wrong, is not looked at.

        Parameters
        ----------
        geometry : ScanGeometry, optional
            As in `from_fields`.
        upside_down : bool
            The sensor's z axis points down: the scan is that of an upright sensor with the same x axis.
        turn : float
            Added to all bearings, of the upright sensor [rad]: the scan is that of a sensor turned by so much
            clockwise.

        Raises
        ------
        ScanError
            When the message's stamp, angles or number of ranges cannot be those of a scan.
        """
        stamp, sign = message.header.stamp, -1.0 if upside_down else 1.0
        if not 0 <= stamp.nanosec < SECOND:
            raise ScanError(f'header.stamp.nanosec = {stamp.nanosec}: expected less than {SECOND}')
        return cls.from_fields(stamp.sec * SECOND + stamp.nanosec, message.ranges, sign * message.angle_min + turn,
                               sign * message.angle_increment, message.range_min, message.range_max,
                               message.time_increment, message.header.frame_id, geometry)

    @classmethod
    def from_points(cls, points: npt.ArrayLike, stamp: int = 0, range_min: float = 0.0, range_max: float = math.inf,
                    frame_id: str = '', angle_increment: float | None = None) -> 'Scan':
        """A scan with the returns at `points` ``(N, 2)`` [m], in beam order, one bearing each.

        Rows that are not finite become beams without a return. `angle_increment` as in `ScanGeometry.from_bearings`.
        """
        points = np.asarray(points, dtype=float)
        ranges = np.hypot(points[:, 0], points[:, 1])
        bearings = np.arctan2(points[:, 1], points[:, 0])
        missing = ~np.isfinite(ranges)
        if missing.all():
            raise ScanError('no finite point')
        known = np.flatnonzero(~missing)
        bearings[missing] = np.interp(np.flatnonzero(missing), known, np.unwrap(bearings[known]))
        ranges[missing] = np.inf
        geometry = ScanGeometry.from_bearings(bearings, range_min, range_max, angle_increment)
        return cls(stamp, ranges, geometry, 0.0, frame_id)


def _single(*values: float) -> list[float]:
    """The `values` rounded to float32; infinite beyond its range."""
    try:
        return array.array('f', values).tolist()
    except TypeError as error:
        raise ScanError(f'{", ".join(map(repr, values))}: expected numbers') from error


def _frozen(values: np.ndarray) -> np.ndarray:
    values.flags.writeable = False
    return values
