# SPDX-License-Identifier: Apache-2.0
"""The odometry of a replay: with the scans of several lidars and the recorded wheel odometry, as in the node."""
import dataclasses
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

from ..core.errors import ScanError
from ..core.geometry.se2 import SE2
from ..core.odometry.calibration.odd_one import UNFIT, named
from ..core.odometry.pipeline import Odometry
from ..core.registration.records import Status
from ..core.sensor import FIRST, Sensor
from ..recordings.checks.scan_checks import Kind
from ..recordings.recording import StampedPoses
from ..robot.base_state import base_motion, external_prior, measured_prior, sensor_prior
from ..robot.own_body import OwnBody, advice, described
from ..robot.pose_history import HeadingHistory, PoseHistory
from ..robot.scan_buffer import RecordedScans
from .in_map import OdometryInMap
from .lidars import lidars_of, prepared
from .trajectory import Trajectory

WHEELS, GYROSCOPE = 'odometry', 'imu'
"""Values of ``prior.source``, alone or joined by ``+``, with which a replay uses recorded wheels and yaw rates."""


class RecordedMotion(NamedTuple):
    """What a recording says about the motion of the robot, as far as it is wanted and recorded."""

    wheels: StampedPoses | None = None
    """(stamps (N,) int64 [ns], poses (N, 3) float [m, m, rad]): wheel odometry of the base."""
    yaw_rates: StampedPoses | None = None
    """(stamps (N,) int64 [ns], rates (N,) float [rad/s])"""

    def backward(self, ends) -> 'RecordedMotion':
        """Return the motion of the same drive backward in time; `ends` is the sum of its first and last stamp."""
        wheels, rates = self
        return RecordedMotion(wheels and (ends - wheels[0][::-1], wheels[1][::-1]),
                              rates and (ends - rates[0][::-1], -rates[1][::-1]))


def _sources(parameters) -> set[str]:
    """Return which of `WHEELS` and `GYROSCOPE` the parameters use."""
    return {WHEELS, GYROSCOPE} & set(parameters.prior.source.split('+'))


def recorded_motion(parameters, recording) -> RecordedMotion:
    """Return what the `parameters` use of the recorded motion of the robot."""
    used = _sources(parameters)
    return RecordedMotion(recording.wheel_odometry() if WHEELS in used else None,
                          recording.yaw_rates() if GYROSCOPE in used else None)


def replay_odometry(parameters, others, topic, mounting, motion, bodies=None):
    """Return the `ReplayOdometry` of a recording; `motion` is a `RecordedMotion`, the rest as for this class."""
    odometry = ReplayOdometry(Odometry(parameters.for_odometry()), others, topic, mounting, parameters)
    odometry.priors = RecordedPriors(motion, mounting, parameters.prior) if any(motion) else None
    odometry.bodies = bodies
    return odometry


def prior_parameters(parameters) -> set[str]:
    """Return the full names of the parameters that the use of a recorded motion needs; none if none is used."""
    if not _sources(parameters):
        return set()
    names = {each.name for each in parameters.describe()}
    return {name for name in names if name.removeprefix('advanced.').startswith('prior.')} - {'prior.frame'}


def describe_prior(parameters, motion) -> list:
    """Return a line about the external prior, as (name, text) pairs; none if none is wanted."""
    used = _sources(parameters)
    if not used:
        return []
    parts = [(WHEELS, motion.wheels, 'wheel odometry'), (GYROSCOPE, motion.yaw_rates, 'IMU')]
    found = ' and '.join(name for source, part, name in parts if source in used and part)
    missing = ' and no '.join(name for source, part, name in parts if source in used and not part)
    return [('prior', (f'the recorded {found}' if found else 'none')
             + (f', as the recording has no {missing}' if missing else ''))]


def replayed_trajectory(recording, scans, lidars, parameters, map_file=None) -> Trajectory:
    """Run the odometry over the `scans` of the first lidar, that of the `recording`, without writing results.

    With a `map_file` the poses are those in this map.
    """
    mounting, others = lidars_of(recording, lidars, parameters)
    odometry = replay_odometry(parameters, others, recording.topic, mounting, recorded_motion(parameters, recording))
    trajectory = Trajectory(mounting.pose.theta, mounting.upside_down, numbers=odometry.numbers if others else [])
    if map_file:
        odometry = OdometryInMap(odometry, map_file, parameters.for_odometry())
    for _ in trajectory.follow(prepared(scans, mounting, parameters.input_of(recording.topic)), odometry):
        pass
    return trajectory


@dataclass(eq=False)
class LidarCounts:
    """Scans of one lidar in a replay, by outcome."""

    unused: int = 0
    """Number of scans before the first and after the last scan of the first lidar, which are not used."""
    ignored: Counter[str] = field(default_factory=Counter)
    """Number of scans that were not used, by reason: `ComparedLidar.reason`."""
    skipped: int = 0
    """Number of scans that could not be used."""
    problem: str = ''
    """Why the last skipped scan could not be used."""
    error: str = ''
    """With which lidars it disagrees, and by how much, or why it was never used; empty if it agrees."""
    statuses: Counter[Status] = field(default_factory=Counter)
    """Number of the processed scans by `Status`."""

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


class ReplayOdometry:
    """Odometry over the scans of all lidars in the order of their stamps, each with its external prior.

    Only scans of the lidar on the topic `first` return an update; updates are numbered as if there were no `others`
    (`RecordedLidar`). The `parameters` have mask, time offset and limits of each lidar.

    Attributes
    ----------
    priors : RecordedPriors or None
        External priors of the scans.
    bodies : OwnBodies or None
        Receives each scan.
    recordings : list of Recording
        Recordings with the topics of the other lidars.
    counts : dict
        Topic of a lidar -> `LidarCounts`, beginning with the first lidar.
    numbers : list of int
        Number of each scan of the first lidar among the scans of all lidars.
    """

    def __init__(self, odometry, others, first, mounting, parameters):
        self.priors = self.bodies = None
        self.parameters, self.mounting = parameters, mounting
        self.recordings = [other.recording for other in others]
        self._odometry, self._first = odometry, FIRST
        if others:
            self._first = Sensor(first, limits=parameters.lidar(first).scan)
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
        if not self.recordings:
            return update
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
            prior = self.priors and self.priors.prior(scan.stamp, self._odometry.predict_motion)
            update = self._odometry.process(scan, prior, sensor)
        except ScanError as error:
            counts.skipped += 1
            counts.problem = str(error)
            raise
        if update.waits:
            compared = self._odometry.comparisons.lidars.get(sensor.name)
            counts.ignored[compared.reason if compared else 'as they repeat the scan before'] += 1
        else:
            counts.statuses[update.status] += 1
            if self.priors:
                self.priors.last = scan.stamp
        if self.bodies:
            self.bodies.add(scan, update)
        return update


class RecordedPriors:
    """Recorded wheels and yaw rates as the external prior of each scan, as `node.priors.Priors` has it.

    `mounting` is that of the first lidar, of which the odometry estimates the pose; `last` the stamp [ns] of the last
    scan of any lidar that was used, or None.
    """

    def __init__(self, motion, mounting, parameters):
        self._mounting, self._parameters = mounting, parameters
        wheels, rates = (zip(each[0].tolist(), each[1].tolist(), strict=True) if each else iter(()) for each in motion)
        self._wheels, self._rates = ((stamp, SE2(*pose)) for stamp, pose in wheels), rates
        self._poses, self._headings = PoseHistory(), HeadingHistory()
        self.last: int | None = None

    def prior(self, stamp, predict):
        """Return the motion of the first lidar since the `last` scan; None where nothing was recorded.

        `predict` returns the prediction of the motion model at a stamp: the translation where there are no wheels.
        """
        _read(self._wheels, self._poses, self._poses.add, stamp)
        _read(self._rates, self._headings, self._headings.add_rate, stamp)
        if self.last is None:
            return None
        driven, rotation = (each.motion(self.last, stamp) for each in (self._poses, self._headings))
        base = external_prior(measured_prior(driven, self._parameters) if driven else None, rotation,
                              lambda: self._predicted(predict(stamp)), self._parameters)
        return base and sensor_prior(base, self._mounting, self._mounting)

    def _predicted(self, prior):
        """Return the prediction of the motion model, as a motion of the base."""
        return prior and base_motion(prior, self._mounting, self._mounting)


def _read(ahead, history, add, stamp):
    """Add what is recorded up to a `stamp` to its history."""
    while not history.reaches(stamp) and (following := next(ahead, None)):
        add(*following)


class OwnBodies:
    """Finds for each lidar where it sees the robot itself, as the node does; collects what the odometry finds.

    `lidars` are topic and mounting of each lidar, in the order of their ranks.
    """

    def __init__(self, lidars):
        self._lidars = [(topic, mounting, OwnBody()) for topic, mounting in lidars]
        self._findings = []

    def add(self, scan, update):
        """Add a scan and its `OdometryUpdate`."""
        topic, _, body = self._lidars[update.sensor.rank]
        if update.finding:
            text = f'{update.finding} (from scan {update.number} on)'
            self._findings.append((topic, Kind.TIME_INCREMENT.value, text))
        body.add(scan, update.pose @ update.sensor.pose)

    def found(self, parameters) -> list:
        """Return topic of the lidar, kind, and a sentence with what to do, for all that was found."""
        seen = [(parameters.lidar(topic), topic, [each.in_lidar(mounting) for each in body.sectors])
                for topic, mounting, body in self._lidars if body.sectors]
        several = len(self._lidars) > 1
        return self._findings + [
            (topic, 'own_body', f'{described(sectors)}; {advice(lidar.name, several, lidar.input.mask, sectors)}')
            for lidar, topic, sectors in seen]
