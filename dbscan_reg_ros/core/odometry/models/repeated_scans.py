# SPDX-License-Identifier: Apache-2.0
"""Frozen lidars: a driver that sends the same ranges with new stamps."""
import math
from dataclasses import dataclass

from ...errors import ScanError
from ...geometry.se2 import SE2
from ...registration.records import Prior
from ...scan import SECOND, Scan
from .stamps import seconds

_IDENTITY = SE2()


@dataclass
class _Run:
    """Latest scans of one lidar that have the same ranges.

    Attributes
    ----------
    ranges : bytes
        Ranges of these scans, bit by bit, as those of beams without a return may be no numbers.
    begin, last : int [ns]
        Stamps of the first and of the latest of these scans.
    used : bool
        Whether one of them changed the track.
    by_others, by_wheels : SE2
        Motion since the first of them, by the scans of other lidars and by external priors.
    """

    ranges: bytes
    begin: int
    last: int
    used: bool = False
    by_others: SE2 = _IDENTITY
    by_wheels: SE2 = _IDENTITY

    @property
    def repeats(self) -> bool:
        """Whether a scan was repeated."""
        return self.last > self.begin


class RepeatedScans:
    """Finds lidars that repeat a scan while the robot moves.

    The ranges of a lidar have noise, so that no two scans of a moving lidar are equal. The scans of a lidar at rest may
    be equal if its ranges are exact or coarse. So the motion decides, which other lidars or the wheels measure.
    """

    def __init__(self) -> None:
        self._runs: dict[str, _Run] = {}

    def add(self, sensor: str, scan: Scan, prior: Prior | None, patience: float) -> bool:
        """Add a scan before it is used; return whether to leave it out.

        A repeated scan is left out while another lidar sends new scans, which measure the motion.

        Parameters
        ----------
        sensor : str
            Name of the lidar.
        scan : Scan
        prior : Prior or None
            External prior: the motion since the last scan that was used.
        patience : float [s]
            Another lidar counts as silent after this time without a new scan.

        Raises
        ------
        ScanError
            When the lidar repeats a scan, but the robot has moved.
        """
        run, ranges = self._runs.get(sensor), scan.ranges.tobytes()
        if run is None or run.ranges != ranges or scan.stamp < run.last:
            self._runs[sensor] = _Run(ranges, scan.stamp, scan.stamp)
            return False
        run.last = scan.stamp
        compared = run.repeats and any(
            other.used and not other.repeats and other.begin > run.begin
            and scan.stamp - other.begin <= patience * SECOND for other in self._runs.values())
        motion = run.by_others if compared else run.by_wheels @ _measured(prior)
        distance, angle = math.hypot(motion.x, motion.y), abs(motion.theta)
        if run.repeats and max(distance, angle) > _MOVED:
            raise ScanError(f'the lidar repeats the same scan: its {len(scan.ranges)} ranges are those of '
                            f'{seconds(run.last - run.begin):.2f} s before, but the robot has moved by '
                            f'{distance:.2f} m and {math.degrees(angle):.0f} deg')
        return compared

    def used(self, sensor: str, motion: SE2 | None, prior: Prior | None) -> None:
        """Add a scan that changed the track.

        Parameters
        ----------
        sensor : str
            Name of its lidar.
        motion : SE2 or None
            Motion since the last scan of any lidar, by this scan; None if its status is not ``OK``.
        prior : Prior or None
            External prior: the same motion.
        """
        for name, run in self._runs.items():
            if name == sensor:
                run.used = True
                if not run.repeats:
                    continue
            elif motion is not None:
                run.by_others @= motion
            run.by_wheels @= _measured(prior)


def _measured(prior: Prior | None) -> SE2:
    """Return the motion that a `prior` measures; the identity if it has the translation from the motion model."""
    return prior.transform if prior is not None and prior.measures_translation else _IDENTITY


_MOVED = 0.05
"""Motion [m, rad] that changes some range of every lidar: above the resolution of ranges and the noise of a pose."""
