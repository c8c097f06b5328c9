# SPDX-License-Identifier: Apache-2.0
"""Warnings about faults in the fields of scans."""
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum


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
