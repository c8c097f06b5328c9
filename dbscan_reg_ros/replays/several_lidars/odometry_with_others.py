# SPDX-License-Identifier: Apache-2.0
"""Odometry with the scans of several lidars, and the number of scans of each by outcome."""
import dataclasses
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field

from ...core.errors import ScanError
from ...core.odometry.calibration.odd_one import UNFIT, named
from ...core.registration.records import Status
from ...core.sensor import Sensor
from ...robot.scan_buffer import RecordedScans


@dataclass(eq=False)
class LidarCounts:
    """Scans of one lidar in a replay, by outcome.

    Attributes
    ----------
    unused : int
        Number of scans before the first and after the last scan of the first lidar, which are not used.
    ignored : Counter
        Number of scans that were not used, by reason: `ComparedLidar.reason`.
    skipped : int
        Number of scans that could not be used.
    problem : str
        Why the last skipped scan could not be used.
    error : str
        With which lidars it disagrees, and by how much, or why it was never used; empty if it agrees.
    statuses : Counter
        Number of the processed scans by `Status`.
    """

    unused: int = 0
    ignored: Counter[str] = field(default_factory=Counter)
    skipped: int = 0
    problem: str = ''
    error: str = ''
    statuses: Counter[Status] = field(default_factory=Counter)

    def measures(self) -> dict:
        """Return the number of scans by outcome; ``scans`` is the number of all except the `unused` ones."""
        counts = {status.value: self.statuses[status] for status in Status}
        ignored = self.ignored.total()
        scans = self.skipped + ignored + sum(counts.values())
        return {'scans': scans, 'skipped': self.skipped, 'ignored': ignored, **counts}

    def __str__(self) -> str:
        counts = [f'{name} {count}' for name, count in self.measures().items() if count or name == 'skipped']
        outside = f', {self.unused} not used, as before or after all scans of the first lidar' if self.unused else ''
        ignored = ''.join(f'; {count} ignored {reason}' for reason, count in self.ignored.items())
        problem = f'; the last skipped: {self.problem}' if self.problem else ''
        error = f'; {self.error}' if self.error else ''
        return ' '.join(counts) + outside + problem + error + ignored


class OdometryWithOthers:
    """Odometry that processes the scans of all lidars in the order of their stamps.

    Only scans of the first lidar return an update; updates are numbered as if there were no other lidars.

    Parameters
    ----------
    odometry : Odometry
    others : list of FurtherLidar
    first : str
        Topic of the first lidar.
    mounting : Mounting
        Mounting of the first lidar.
    parameters : NodeParameters
        Their `lidar` has mask, time offset and limits of each lidar.

    Attributes
    ----------
    recordings : list of Recording
        Recordings with the topics of the other lidars.
    counts : dict
        Topic of a lidar -> `LidarCounts`, beginning with the first lidar.
    numbers : list of int
        Number of each scan of the first lidar among the scans of all lidars.
    """

    def __init__(self, odometry, others, first, mounting, parameters):
        self._odometry, self._first = odometry, Sensor(first, limits=parameters.lidar(first).scan)
        self.recordings = [other.recording for other in others]
        self._sensors = [self._first, *(other.sensor(mounting, rank) for rank, other in enumerate(others, 1))]
        self._others = RecordedScans((other.scans(parameters.input_of(other.recording.topic)) for other in others), 1)
        self.counts = {sensor.name: LidarCounts() for sensor in self._sensors}
        self.numbers: list[int] = []
        self._used: dict[int, int] = {}
        self._others_read = 0

    def process(self, scan):
        """Process the older scans of the other lidars, then a `scan` of the first lidar; return its update."""
        for other in self._others.before(scan.stamp):
            self._process_other(other)
        self.numbers.append(len(self.numbers) + self._others_read)
        update = self._process(scan, self._first)
        number = self._used[update.number] = len(self._used)
        reference = self._used.get(update.reference_number)
        return dataclasses.replace(update, number=number, reference_number=reference)

    def finish(self):
        """Count the scans after the last scan of the first lidar, and name the lidars that disagree."""
        compared = [self._odometry.comparisons.lidars.get(sensor.name) for sensor in self._sensors]
        for sensor, lidar, odd in zip(self._sensors, compared, named(self._first.pose, compared[1:]), strict=True):
            if odd:
                self.counts[sensor.name].error = f'{odd} (see calibrate)'
            elif lidar and lidar.unfit:
                self.counts[sensor.name].error = UNFIT
        for other in self._others.before():
            self.counts[self._sensors[other.lidar].name].unused += 1

    def _process_other(self, other):
        """Process a scan of another lidar, which is not used before the first scan of the first lidar."""
        sensor = self._sensors[other.lidar]
        self._others_read += 1
        if not self._used:
            self.counts[sensor.name].unused += 1
            return
        with suppress(ScanError):
            self._process(other.scan, sensor)

    def _process(self, scan, sensor):
        """Return the update of a scan of the lidar `sensor`, and count it; raise a ScanError if it is unusable."""
        counts = self.counts[sensor.name]
        try:
            update = self._odometry.process(scan, None, sensor)
        except ScanError as error:
            counts.skipped += 1
            counts.problem = str(error)
            raise
        if update.waits:
            compared = self._odometry.comparisons.lidars.get(sensor.name)
            counts.ignored[compared.reason if compared else 'as they repeat the scan before'] += 1
        else:
            counts.statuses[update.status] += 1
        return update
