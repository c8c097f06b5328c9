# SPDX-License-Identifier: Apache-2.0
"""Fields of a LaserScan message, and checks of the stamp, the numbers and the beam angles of a scan."""
import operator
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt

from .errors import ScanError

UNEVEN_BEYOND = 0.5
"""A step between two beams that differs by more than this fraction from the median step is an error."""


class Stamp(Protocol):
    """The fields of a builtin_interfaces/Time message."""

    sec: int
    nanosec: int


class Header(Protocol):
    """The fields of a std_msgs/Header message."""

    stamp: Stamp
    frame_id: str


class LaserScanMessage(Protocol):
    """The fields of a sensor_msgs/LaserScan message that a scan is made of."""

    header: Header
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    time_increment: float
    ranges: Sequence[float]


def check_stamp(stamp: object) -> int:
    """Return a stamp [ns] as an int; raise ScanError if it is no whole number."""
    try:
        return operator.index(stamp)  # type: ignore[arg-type] # whatever is no whole number is an error
    except TypeError as error:
        raise ScanError(f'stamp = {stamp!r}: expected whole nanoseconds (int); '
                        'from seconds: round(seconds * 1e9)') from error


def check_numbers(name: str, values: npt.ArrayLike, kind: npt.DTypeLike) -> np.ndarray:
    """Copy `values` to an array ``(N,)`` of the type `kind`; raise ScanError if they are not one list of numbers."""
    try:
        array = np.array(values)
    except ValueError as error:
        raise ScanError(f'{name} in rows of different lengths; '
                        'expected one number for each beam, shape (N,)') from error
    if array.dtype.kind not in 'fiu':
        raise ScanError(f'{name} of type {array.dtype}; expected real numbers')
    if array.ndim != 1:
        raise ScanError(f'{name} of shape {array.shape}; expected one number for each beam, shape (N,)')
    return array.astype(kind, copy=False)


def check_angles(angles: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the angles of the beams ``(N,)`` [rad] without a jump from pi to -pi, and their median step [rad].

    Raises
    ------
    ScanError
        When the angles are fewer than two, not finite, not in order, or not about equally spaced.
    """
    if len(angles) <= 1:
        raise ScanError(f'{len(angles)} angles; expected one for each beam of a scan, at least 2')
    wrong = np.flatnonzero(~np.isfinite(angles))
    if len(wrong):
        raise ScanError(f'angles[{wrong[0]}] = {angles[wrong[0]]}; expected finite angles [rad], '
                        'also for beams without a return')
    bearings = np.unwrap(angles)
    steps = np.diff(bearings)
    step = float(np.median(steps))
    wrong = np.flatnonzero(steps * step <= 0.0)
    if len(wrong):
        k = int(wrong[0])
        raise ScanError(f'angles[{k}] = {angles[k]:.6g} and angles[{k + 1}] = {angles[k + 1]:.6g} are out of order; '
                        'sort ranges and angles by angle: order = numpy.argsort(angles)')
    wrong = np.flatnonzero(np.abs(steps - step) > UNEVEN_BEYOND * abs(step))
    if len(wrong):
        k = int(wrong[0])
        raise ScanError(f'angles[{k}] and angles[{k + 1}] are {steps[k] / step:.3g} times as far apart as most; '
                        'expected about equal steps [rad]: keep the beams without a return, with the range inf')
    return bearings, step
