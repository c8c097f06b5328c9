# SPDX-License-Identifier: Apache-2.0
"""Scans of several sensors: the intervals between them, and the last one of each."""
import dataclasses
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


class ScanOrder:
    """Stamps of the scans of all sensors, in the order in which they are used."""

    def __init__(self) -> None:
        self._last: tuple[str, int] | None = None

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
            `own` if the last scan was of the same sensor; otherwise the difference of the stamps. It is negative if the
            new scan is older than the last one: then the state is predicted back to the stamp of the new scan.
        """
        last, self._last = self._last, (sensor, stamp)
        if last is None or last[0] == sensor:
            return own
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
