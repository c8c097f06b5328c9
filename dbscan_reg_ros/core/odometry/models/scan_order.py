# SPDX-License-Identifier: Apache-2.0
"""Scans of several sensors: the intervals between them, and the last one of each."""
import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass

from ...geometry.se2 import SE2
from ...parameters.odometry import TimeParameters
from .stamps import Jump, ScanInterval, StampFilter, seconds


@dataclass
class ScanMiddle:
    """The last scan of one sensor.

    Attributes
    ----------
    pose : SE2
        Pose of the first sensor in the middle of this scan, in the odometry frame.
    time : float [s]
        Time from the middle of this scan to the stamp of the last scan of any sensor.
    degenerate : bool
        Whether a direction of the translation was degenerate for this scan.
    constrained_count : int
        Number of scans of all sensors, up to this scan, that constrained every direction.
    """

    pose: SE2
    time: float
    degenerate: bool
    constrained_count: int


def scan_before(scans: Mapping[str, ScanMiddle], sensor: str) -> ScanMiddle | None:
    """Return which of the last `scans` to compute the velocity of a scan of a `sensor` from; None if it is to be kept.

    Over a long time the mean velocity is not the present one; over a short time an error of the mounting dominates.
    """
    own, latest = scans.get(sensor), min(scans.values(), key=lambda scan: scan.time, default=None)
    if own is latest or (own is not None and own.time <= _MAX_OWN_TIME):
        return own
    return latest if latest is not None and latest.time >= _MIN_TIME else None


class ScanOrder:
    """Stamps of the scans of all sensors, in the order in which they are used."""

    def __init__(self) -> None:
        self._last: tuple[str, int] | None = None
        self._several = False

    def lateness(self, sensor: str, stamp: int, parameters: TimeParameters) -> float:
        """Return by how much [s] a scan is older than the last scan of another sensor; 0 if tolerable or a jump."""
        if self._last is None or self._last[0] == sensor:
            return 0.0
        late = seconds(self._last[1] - stamp)
        return late if _MAX_LATE < late <= parameters.max_jump else 0.0

    def time_since_last(self, stamp: int) -> float:
        """Return the time [s] from the last scan of any sensor to a `stamp` [ns]."""
        return 0.0 if self._last is None else seconds(stamp - self._last[1])

    def since_last(self, sensor: str, stamp: int, own: ScanInterval, stamps: StampFilter,
                   parameters: TimeParameters) -> ScanInterval:
        """Add a scan of a `sensor`, and return the interval since the last scan of any sensor.

        Parameters
        ----------
        sensor : str
        stamp : int [ns]
        own : ScanInterval
            Interval since the last scan of the same sensor.
        stamps : StampFilter
            Filter of the stamps of this sensor.
        parameters : TimeParameters

        Returns
        -------
        ScanInterval
            `own` if the last scan was of the same sensor, by the stamps once scans of several sensors were used: of one
            sensor alone they are too irregular then to tell jitter from dropped scans. Otherwise the difference of the
            stamps. It is negative if the new scan is older than the last one: then the state is predicted back to the
            stamp of the new scan.
        """
        last, self._last = self._last, (sensor, stamp)
        if last is None or last[0] == sensor:
            by_stamps = self._several and own.jump is None and own.elapsed > 0.0
            return dataclasses.replace(own, length=own.elapsed, steady=True, sigma=0.0) if by_stamps else own
        self._several = True
        elapsed = seconds(stamp - last[1])
        if abs(elapsed) > parameters.max_jump:
            jump = Jump.FORWARD if elapsed > 0.0 else Jump.BACKWARD
            reason = f'no scan for {elapsed:.3f} s' if jump is Jump.FORWARD else f'stamps went back by {-elapsed:.3f} s'
            return ScanInterval(stamps.typical, max(elapsed, 0.0), own.middle_offset, jump, reason,
                                own.missing or not own.elapsed)
        interval = dataclasses.replace(own, length=elapsed, elapsed=elapsed, jump=None, reason='', of_others=True)
        typical = stamps.typical
        late = typical and dataclasses.replace(interval, length=typical).gap
        return dataclasses.replace(interval, length=typical) if late else interval


_MAX_LATE = 0.25
"""A scan may be older than the last one by this time [s]: slow lidars send a scan so long after its first beam."""
_MAX_OWN_TIME = 0.5
"""Time [s] since the last scan of a sensor up to which the velocity is computed from it."""
_MIN_TIME = 0.2
"""Time [s] from which on a velocity is computed between scans of different sensors."""
