# SPDX-License-Identifier: Apache-2.0
"""Time of scans: how long they take, and the intervals between them."""
from enum import Enum
from typing import NamedTuple

from ...features.records import Features
from ...scan import SECOND, Scan


class Jump(Enum):
    """Direction of a jump of the stamps."""

    FORWARD = 'forward'
    BACKWARD = 'backward'


def jump_of(elapsed: float) -> tuple[Jump, str]:
    """Return the direction of a jump of the stamps by `elapsed` [s], and its description."""
    if elapsed > 0.0:
        return Jump.FORWARD, f'no scan for {elapsed:.3f} s'
    return Jump.BACKWARD, f'stamps went back by {-elapsed:.3f} s'


class ScanTiming(NamedTuple):
    """How long a scan takes.

    Attributes
    ----------
    duration : float [s]
        Time from the first beam to the last according to `Scan.time_increment`; 0 if all beams are measured at once.
    ratio : float
        Ratio of the estimated true duration to `duration`, at most 1: drivers may report a wrong `time_increment`.
    deskews : bool
        Whether the motion within the scan can be removed.
    """

    duration: float
    ratio: float
    deskews: bool

    def middle_offset(self, scan: Scan, features: Features) -> float:
        """Return the time [s] from the stamp of a scan to the middle of its returns."""
        return middle_offset(scan, features, self.ratio) if self.duration else 0.0


class ScanInterval(NamedTuple):
    """The time from one scan to the next.

    Attributes
    ----------
    length : float [s]
        Difference of the stamps if the stamps are `steady` or it is plausible; otherwise the running median, or a
        multiple of it if a scan takes a time. 0 while unknown.
    elapsed : float [s]
        Difference of the stamps; 0 if the stamps went back.
    middle_offset : float [s]
        Time from the stamp of the scan to the middle of its beams.
    jump : Jump or None
        Direction of a jump of the stamps by more than `time.max_jump`.
    reason : str
        Description of the jump; empty without a jump.
    missing : bool
        Whether scans are missing: the stamps jumped forward, and the interval is far longer than the usual one.
    steady : bool
        Whether the stamps are right, so that a long interval means dropped scans.
    of_others : bool
        Whether the last scan was of another sensor, so that successive intervals may differ in length.
    sigma : float [s]
        Standard deviation of `length`: the stamps may jitter, or be right and scans were dropped.
    """

    length: float
    elapsed: float
    middle_offset: float
    jump: Jump | None = None
    reason: str = ''
    missing: bool = False
    steady: bool = False
    of_others: bool = False
    sigma: float = 0.0

    @property
    def gap(self) -> bool:
        """Whether the last velocity cannot predict the motion: scans are missing for long, or the stamp is wrong."""
        return self.jump is not None or self.elapsed > GAP_RATIO * abs(self.length)

    def measures_velocity(self, time: float) -> bool:
        """Whether a velocity can be computed from the last scan of the same sensor, which is `time` [s] old."""
        known = time > 0.0 if self.of_others else self.length > 0.0 and self.elapsed > 0.0
        return known and not self.gap


def middle_offset(scan: Scan, features: Features, ratio: float) -> float:
    """Return the time [s] from the stamp to the middle of the returns, with the scan's duration times `ratio`."""
    return ratio * scan.time_increment * float(features.beams.mean())


def seconds(nanoseconds: int) -> float:
    """Return a difference of stamps [ns] in seconds."""
    return nanoseconds * (1.0 / SECOND)


GAP_RATIO = 10.0
"""An interval longer than this multiple of the median is a gap; jitter alone may reach eight times the median."""
