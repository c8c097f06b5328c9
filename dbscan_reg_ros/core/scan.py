# SPDX-License-Identifier: Apache-2.0
"""Laser scans (Eq. 2), made from arrays, points or LaserScan messages."""
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .beams import LaserScanMessage, Stamp, check_numbers, check_stamp
from .errors import ScanError, expect
from .geometry.array_types import BoolArray, FloatArray
from .scan_geometry import ScanGeometry, read_only, single_precision

MAX_RANGE = 100_000.0
"""Ranges from this [m] on are not returns, even if the `range_max` of the sensor is larger."""
SECOND = 1_000_000_000
"""Nanoseconds in a second."""


def in_nanoseconds(stamp: Stamp) -> int:
    """Convert the stamp of a message to nanoseconds."""
    return stamp.sec * SECOND + stamp.nanosec


@dataclass(frozen=True, eq=False)
class Scan:
    """One sweep of a 2D lidar, immutable.

    Parameters
    ----------
    stamp : int
        Time of the first beam [ns].
    ranges : array_like (N,)
        Measured ranges [m], rounded to float32; `inf`, `nan`, 0, negative values and values outside the limits of the
        geometry are beams without a return (REP-117).
    geometry : ScanGeometry
    time_increment : float
        Time from one beam to the next [s]; 0 where unknown.
    frame_id : str
        Coordinate frame of the sensor.

    Raises
    ------
    ScanError
        When the stamp is no whole number, a range is no number, or the geometry is none or has another number of beams.
    """

    stamp: int
    ranges: NDArray[np.float32]
    geometry: ScanGeometry
    time_increment: float = 0.0
    frame_id: str = ''

    def __post_init__(self) -> None:
        object.__setattr__(self, 'stamp', check_stamp(self.stamp))
        with np.errstate(over='ignore'):
            ranges = check_numbers('ranges', self.ranges, np.float32)
        expect('geometry', self.geometry, ScanGeometry, 'ScanGeometry(angle_min, angle_increment, size)', ScanError)
        if len(ranges) != self.geometry.size:
            raise ScanError(f'{len(ranges)} ranges for {self.geometry.size} beams')
        object.__setattr__(self, 'ranges', read_only(ranges))
        increment, = single_precision(self.time_increment)
        object.__setattr__(self, 'time_increment', increment if math.isfinite(increment) else 0.0)

    def __repr__(self) -> str:
        first, last = np.degrees(self.geometry.bearings[[0, -1]])
        returns = self.ranges[self.valid]
        reach = f' at {returns.min():.2f} to {returns.max():.2f} m' if len(returns) else ''
        return (f'Scan({self.geometry.size} beams from {first:.1f} to {last:.1f} deg, {len(returns)} returns{reach}, '
                f'stamp {self.stamp} ns)')

    @cached_property
    def valid(self) -> BoolArray:
        """``(N,)`` bool: beams with a return from `range_min` to below `range_max`."""
        ranges, geometry = self.ranges, self.geometry
        with np.errstate(invalid='ignore'):
            ok = (ranges > 0.0) & (ranges >= np.float32(geometry.range_min))
            ok &= ranges < np.float32(min(geometry.range_max, MAX_RANGE))
        return read_only(ok)

    @cached_property
    def points(self) -> FloatArray:
        """``(N, 2)`` Cartesian points [m] in the sensor's frame (Eq. 2); not finite without a return."""
        ranges = np.where(self.valid, self.ranges.astype(float), np.nan)
        return read_only(ranges[:, None] * self.geometry.directions)

    @property
    def duration(self) -> float:
        """Time that all beams take [s]; 0 where unknown."""
        return abs(self.time_increment) * self.geometry.size

    def as_measured(self, direction: str) -> 'Scan':
        """Return the scan with its beams in the order in which they are measured.

        Parameters
        ----------
        direction : str
            Direction in which the sensor turns, as the parameter `scan.direction`.
        """
        sign = {'clockwise': -1.0, 'counterclockwise': 1.0}.get(direction, 0.0)
        if sign * self.geometry.angle_increment >= 0.0:
            return self
        return Scan(self.stamp, self.ranges[::-1], self.geometry.backwards, self.time_increment, self.frame_id)

    @classmethod
    def from_ranges(cls, ranges: ArrayLike, angles: ArrayLike, *, stamp: int = 0, range_min: float = 0.0,
                    range_max: float = math.inf, time_increment: float = 0.0) -> 'Scan':
        """Make a scan from arrays.

        Parameters
        ----------
        ranges : array_like (N,)
            Measured ranges [m], one for each beam; 0, `inf`, `nan` or masked for a beam without a return.
        angles : array_like (N,)
            Bearing of each beam [rad], in the order of the beams, counter-clockwise or clockwise. A jump from pi to -pi
            is allowed.
        stamp : int
            Time of the first beam [ns].
        range_min, range_max : float
            Ranges below `range_min` and from `range_max` on [m] are no returns.
        time_increment : float
            Time from one beam to the next [s]; 0 where unknown.

        Raises
        ------
        ScanError
            When the arrays differ in shape or contain anything but numbers, when the angles are not finite, not in
            order, or not about equally spaced, or when the stamp is no whole number.
        """
        if isinstance(ranges, np.ma.MaskedArray):
            ranges = np.ma.filled(ranges.astype(float), np.nan)
        distances, bearings = check_numbers('ranges', ranges, float), check_numbers('angles', angles, float)
        if len(distances) != len(bearings):
            raise ScanError(f'{len(distances)} ranges for {len(bearings)} angles: expected one angle for each range')
        return cls(stamp, distances, ScanGeometry.from_angles(bearings, range_min, range_max), time_increment)

    @classmethod
    def from_message(cls, message: LaserScanMessage, geometry: ScanGeometry | None = None, upside_down: bool = False,
                     yaw: float = 0.0) -> 'Scan':
        """Make a scan from any object with the fields of a LaserScan message.

        The beams are counted in `ranges`: many drivers give a wrong `angle_max`, which is ignored.

        Parameters
        ----------
        message : LaserScanMessage
        geometry : ScanGeometry, optional
            Geometry of the last scan, which is used again if the geometry of this scan is equal.
        upside_down : bool
            The z axis of the sensor points down: the scan becomes that of an upright sensor with the same x axis.
        yaw : float
            Yaw of the upright sensor [rad], added to all bearings: the scan becomes that of a sensor with a yaw of 0.

        Raises
        ------
        ScanError
            When the stamp, the angles or the number of ranges of the message are invalid.
        """
        stamp, sign = message.header.stamp, -1.0 if upside_down else 1.0
        if not 0 <= stamp.nanosec < SECOND:
            raise ScanError(f'header.stamp.nanosec = {stamp.nanosec}: expected less than {SECOND}')
        made = ScanGeometry(sign * message.angle_min + yaw, sign * message.angle_increment, len(message.ranges),
                            message.range_min, message.range_max)
        ranges = cast('NDArray[np.float32]', message.ranges)  # converted as any other array_like
        return cls(in_nanoseconds(stamp), ranges, made.reuse(geometry), message.time_increment,
                   message.header.frame_id)

    @classmethod
    def from_points(cls, points: ArrayLike, *, stamp: int = 0, range_min: float = 0.0, range_max: float = math.inf,
                    time_increment: float = 0.0, angle_increment: float | None = None) -> 'Scan':
        """Make a scan with returns at the given points, one beam for each point.

        Parameters
        ----------
        points : array_like (N, 2)
            Positions in the sensor's frame [m]; rows that are not finite become beams without a return. Points that are
            not in the order of their bearings, in at most one turn, are sorted by them, and those rows left out.
        stamp : int
            Time of the first beam [ns].
        range_min, range_max : float
            Points nearer than `range_min` and from `range_max` on [m] are no returns.
        time_increment : float
            Time from one beam to the next [s]; 0 where unknown.
        angle_increment : float, optional
            Step from one beam of the sensor to the next [rad], negative for clockwise lidars. With it the points are in
            the order of the beams and are not sorted, as those of a scan that was moved. By default it is the median
            step of the bearings.

        Raises
        ------
        ScanError
            When the shape is not ``(N, 2)``, no point is finite, or points to sort have a `time_increment`.
        """
        points = np.asarray(points, dtype=float)
        if points.shape[1:] != (2,):
            raise ScanError(f'points of shape {points.shape}; expected one point (x, y) in each row, shape (N, 2)')
        ranges = np.hypot(points[:, 0], points[:, 1])
        bearings = np.arctan2(points[:, 1], points[:, 0])
        missing = ~np.isfinite(ranges)
        if missing.all():
            raise ScanError('no finite point')
        known = np.flatnonzero(~missing)
        turned = np.unwrap(bearings[known])
        if angle_increment is None and not _one_turn(turned):
            if time_increment:
                raise ScanError('the points are not in the order of their bearings, but their time_increment is '
                                f'{time_increment}; expected the order in which they were measured')
            known = known[np.argsort(bearings[known], kind='stable')]
            ranges, bearings = ranges[known], bearings[known]
        else:
            bearings[missing] = np.interp(np.flatnonzero(missing), known, turned)
            ranges[missing] = np.inf
        geometry = replace(ScanGeometry.from_bearings(bearings, angle_increment), range_min=range_min,
                           range_max=range_max)
        return cls(stamp, ranges, geometry, time_increment)


def _one_turn(bearings: FloatArray) -> bool:
    """Whether unwrapped `bearings` ``(N,)`` [rad] only increase or only decrease, by at most a full turn."""
    steps = np.diff(bearings)
    return bool((steps >= 0.0).all() or (steps <= 0.0).all()) and abs(bearings[-1] - bearings[0]) <= 2.0 * math.pi


def expect_scan(value: object) -> None:
    """Raise ScanError if a `value` given as scan is none."""
    expect('scan', value, Scan, 'Scan.from_ranges(ranges, angles)', ScanError)
