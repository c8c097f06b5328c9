# SPDX-License-Identifier: Apache-2.0
"""Geometry of a laser scan: bearings of its beams and limits of its ranges (Eq. 1)."""
import array
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .beams import check_angles
from .errors import ScanError
from .geometry.array_types import FloatArray
from .geometry.se2 import wrap
from .geometry.tolerance import RESOLUTION

MAX_BEAMS = 100_000
UNIFORM_WITHIN = 0.02
"""Beams that deviate from equal spacing by at most this fraction of their step are stored as equally spaced."""


@dataclass(frozen=True)
class ScanGeometry:
    """Bearings of the beams of a scan, and limits of its ranges.

    Geometries compare by value: one object, with its cached sines and cosines, can serve all scans of a sensor.

    Parameters
    ----------
    angle_min : float
        Bearing of beam 0 [rad], rounded to float32.
    angle_increment : float
        Step from one beam to the next [rad], rounded to float32; negative for clockwise lidars.
    size : int
        Number of beams N.
    range_min, range_max : float
        A range is a return when ``range_min <= range < range_max`` [m], rounded to float32: many drivers send
        `range_max` for a missing return. A `range_max` that is not positive, or not finite, means no limit.
    bearings_given : tuple of float, optional
        One bearing [rad] for each beam, if the beams are not equally spaced, as in a deskewed scan.

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
        for name, value in zip(names, single_precision(*(getattr(self, name) for name in names))):
            object.__setattr__(self, name, value)
        if math.isnan(self.range_min):
            object.__setattr__(self, 'range_min', 0.0)
        if not self.range_max > 0.0:
            object.__setattr__(self, 'range_max', math.inf)
        self._check()

    def _check(self) -> None:
        """Raise a ScanError for impossible angles or numbers of beams."""
        if not (math.isfinite(self.angle_min) and math.isfinite(self.angle_increment)):
            raise ScanError(f'angle_min {self.angle_min} and angle_increment {self.angle_increment} must be finite')
        if self.angle_increment == 0.0:
            raise ScanError('angle_increment is 0: the driver must say how far apart its beams are')
        if not 1 <= self.size <= MAX_BEAMS:
            raise ScanError(f'a scan of {self.size} beams; expected 1 to {MAX_BEAMS}')
        if self.bearings_given is None:
            if abs(self.angle_increment) * (self.size - 1) > 4.0 * math.pi:
                raise ScanError(f'{self.size} beams {self.angle_increment} rad apart go round more than twice; angles '
                                'are in radians')
        elif len(self.bearings_given) != self.size:
            raise ScanError(f'{len(self.bearings_given)} bearings for {self.size} beams')

    @classmethod
    def from_bearings(cls, bearings: ArrayLike, angle_increment: float | None = None) -> 'ScanGeometry':
        """Make the geometry of a scan whose beams each have a bearing of their own, without limits of the ranges.

        Parameters
        ----------
        bearings : (N,) float
            Bearing of each beam, in beam order [rad].
        angle_increment : float, optional
            Step from one beam of the sensor to the next [rad]; its sign determines on which side of a surface the
            sensor was. By default it is the median step of the bearings.

        Raises
        ------
        ScanError
            When `bearings` is not an array of one finite number for each beam.
        """
        bearings = np.asarray(bearings, dtype=np.float32).astype(float)
        if bearings.ndim != 1 or not len(bearings) or not np.isfinite(bearings).all():
            raise ScanError('bearings must be one finite number for each beam')
        if angle_increment is None:
            steps = wrap(np.diff(bearings))
            angle_increment = (float(np.median(steps)) or float(steps.mean())) if len(steps) else 1.0
            angle_increment = angle_increment or RESOLUTION
        return cls(float(bearings[0]), angle_increment, len(bearings), bearings_given=tuple(bearings.tolist()))

    @classmethod
    def from_angles(cls, angles: FloatArray, range_min: float, range_max: float) -> 'ScanGeometry':
        """Make the geometry of a scan with about equally spaced beams at `angles` ``(N,)`` [rad], in beam order.

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
        return replace(cls.from_bearings(bearings, step), range_min=range_min, range_max=range_max)

    def reuse(self, previous: 'ScanGeometry | None') -> 'ScanGeometry':
        """Return the `previous` geometry, with its cached arrays, if it is equal to this geometry; else this one."""
        return previous if previous is not None and previous == self else self

    @cached_property
    def bearings(self) -> FloatArray:
        """``(N,)`` bearing of each beam [rad] (Eq. 1)."""
        if self.bearings_given is not None:
            return read_only(np.array(self.bearings_given))
        return read_only(self.angle_min + self.angle_increment * np.arange(self.size))

    @cached_property
    def backwards(self) -> 'ScanGeometry':
        """The same beams in the reverse order."""
        given = self.bearings_given
        return replace(self, angle_min=float(self.bearings[-1]), angle_increment=-self.angle_increment,
                       bearings_given=None if given is None else given[::-1])

    @property
    def closed(self) -> bool:
        """Whether the beams cover the full circle."""
        return abs(self.angle_increment) * (self.size + 1) > 2.0 * math.pi

    @cached_property
    def directions(self) -> FloatArray:
        """``(N, 2)`` unit vector along each beam."""
        return read_only(np.stack((np.cos(self.bearings), np.sin(self.bearings)), axis=1))


def single_precision(*values: float) -> list[float]:
    """Round the `values` to float32; values beyond the range of float32 become infinite."""
    try:
        return array.array('f', values).tolist()
    except TypeError as error:
        raise ScanError(f'{", ".join(map(repr, values))}: expected numbers') from error


def read_only(values: NDArray[Any]) -> NDArray[Any]:
    """Make an array read-only."""
    values.flags.writeable = False
    return values
