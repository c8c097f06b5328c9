# SPDX-License-Identifier: Apache-2.0
"""Several lidars of one recording: the odometry estimates the poses of the first and uses the scans of all."""
import dataclasses
import math
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field

from ..core.errors import RecordingError, ScanError
from ..core.geometry.mounting import Mounting, MountingError
from ..core.geometry.se2 import SE2
from ..core.odometry.calibration.majority import UNFIT, described, disagreeing
from ..core.odometry.sensor import Sensor
from ..core.parameters.features import ScanParameters
from ..core.registration.records import Status
from ..recordings import open_recording
from ..recordings.bags.clouds import CloudParameters
from ..recordings.recording import Recording
from ..robot.mounting import mounting_from_parameters
from ..robot.parameter_groups import InputParameters
from ..robot.sensors import NAMELESS
from .sensor_mounting import mounting_of, prepared

UPSIDE_DOWN = 'upside_down'
"""Optional fifth word of a mounting on the command line: the lidar is mounted upside down."""


def scan_topics(given, parameters) -> tuple[str, ...]:
    """Return the topics of the lidars: those `given` on the command line, else ``scan_topics`` if it has several.

    Relative names in `parameters` (`NodeParameters`) are resolved as in a node without a namespace. A single name in
    ``scan_topics`` is ignored, because the topic may have any name in a recording.
    """
    if given or len(parameters.scan_topics) == 1:
        return tuple(given or ())
    return tuple(f'/{topic.lstrip("/")}' for topic in parameters.scan_topics)


def parse_mountings(given) -> dict:
    """Parse mountings from the command line, NAME X Y DEG [upside_down]; return topic -> `Mounting`.

    Raises a MountingError when a mounting does not have this form.
    """
    mountings = {}
    for name, *words in given or ():
        try:
            x, y, degrees = map(float, words[:3])
            if words[3:] not in ([], [UPSIDE_DOWN]) or not all(map(math.isfinite, (x, y, degrees))):
                raise ValueError
        except ValueError:
            raise MountingError(f'--mounting {" ".join((name, *words))}: expected NAME X Y DEG, in m and deg, and '
                                f'{UPSIDE_DOWN} for a lidar that is mounted upside down') from None
        mountings[name] = Mounting(SE2(x, y, math.radians(degrees)), bool(words[3:]))
    return mountings


@dataclass(frozen=True)
class Lidars:
    """The lidars of recordings, as the user names them.

    Attributes
    ----------
    topics : tuple of str
        Topics of the scans, that of the first lidar first; empty if the recordings have only one.
    mountings : dict
        Topic -> `Mounting`, for the mountings that the user gave.
    """

    topics: tuple[str, ...] = ()
    mountings: dict = field(default_factory=dict)

    @property
    def first(self) -> str | None:
        """Topic of the first lidar, whose poses are estimated; None if the recordings have only one."""
        return self.topics[0] if self.topics else None

    def open(self, path, parameters) -> Recording:
        """Open the recording at `path` with the topic of the first lidar; point clouds as in `parameters`."""
        return open_recording(path, self.first, CloudParameters.of(parameters, self.first, self.mountings))


def mounting_in(recording: Recording, mountings, base_frame, option='--mounting {} X Y DEG, or ') -> Mounting:
    """Return the mounting of the lidar of a `recording`: the mounting given for its topic, else the recorded one.

    `option` begins the advice in the error; it is empty for a command without this option.

    Raises
    ------
    MountingError
        When the mounting is neither given nor recorded.
    """
    if recording.mounting:
        return recording.mounting
    if recording.topic in mountings:
        return mountings[recording.topic]
    try:
        return recording.mounting_on(base_frame)
    except MountingError as error:
        raise MountingError(f'{recording.path}: the mounting of the lidar on {recording.topic} is not known: {error}; '
                            f'state it: {option.format(recording.topic)}NAME.laser_pose with sensors in the parameter '
                            'file') from error


@dataclass(frozen=True, eq=False)
class FurtherLidar:
    """A lidar of a recording other than the first.

    Attributes
    ----------
    recording : Recording
        Recording with the topic of this lidar.
    mounting : Mounting
    limits : ScanParameters
        Limits of its ranges and of its range noise.
    """

    recording: Recording
    mounting: Mounting
    limits: ScanParameters

    def sensor(self, first: Mounting, rank: int) -> Sensor:
        """Return the `Sensor` of the scans of this lidar, which are rotated by the yaw of its mounting."""
        offset = first.aligned_pose.inverse() @ self.mounting.aligned_pose
        return Sensor(self.recording.topic, offset, rank, self.limits)

    def scans(self, parameters: InputParameters):
        """Yield the scans of this lidar without masked returns, rotated to the axes of the base."""
        return prepared(self.recording.scans(), self.mounting, parameters)


def given_mountings(parameters, topics) -> dict:
    """Return topic -> `Mounting` of those of several lidars whose poses the `parameters` (`NodeParameters`) contain."""
    if len(topics) <= 1 or parameters.sensors == NAMELESS:
        return {}
    found = {topic: mounting_from_parameters(parameters.lidar(topic)) for topic in topics}
    return {topic: mounting for topic, mounting in found.items() if mounting}


def further_lidars(first: Recording, topics, mountings, parameters) -> list:
    """Open the other `topics` of the recording `first`; return a `FurtherLidar` for each.

    Raises
    ------
    RecordingError
        When a topic is given twice or holds no scans.
    MountingError
        When the mounting of a lidar is not known.
    """
    if len({first.topic, *topics}) <= len(topics):
        raise RecordingError(f'{first.path}: expected each topic once: {", ".join((first.topic, *topics))}')
    opened = [open_recording(first.path, topic, CloudParameters.of(parameters, topic, mountings)) for topic in topics]
    return [FurtherLidar(recording, mounting_in(recording, mountings, parameters.base_frame),
                         parameters.lidar(recording.topic).scan) for recording in opened]


def lidars_of(first: Recording, lidars: Lidars, parameters, base=False) -> tuple:
    """Return the mounting of the lidar of the recording `first`, and a `FurtherLidar` for each of the other `lidars`.

    The mountings that the user gave come before those of the `parameters`. A recorded mounting is used with several
    lidars, or where poses of the `base` are asked for. Raises as `further_lidars`.
    """
    topics = lidars.topics[1:]
    mountings = given_mountings(parameters, (first.topic, *topics)) | lidars.mountings
    if (topics or base) and parameters.mounting != 'laser_pose':
        mounting = mounting_in(first, mountings, parameters.base_frame)
    else:
        mounting = first.mounting or mountings.get(first.topic) or mounting_of(parameters.lidar(first.topic))
    return mounting, further_lidars(first, topics, mountings, parameters) if topics else []


@dataclass(eq=False)
class LidarCounts:
    """Scans of one lidar in a replay, by outcome.

    Attributes
    ----------
    unused : int
        Number of scans before the first and after the last scan of the first lidar, which are not used.
    ignored : int
        Number of scans before the lidar was found to agree with the first one, and while it disagreed.
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
    ignored: int = 0
    skipped: int = 0
    problem: str = ''
    error: str = ''
    statuses: Counter[Status] = field(default_factory=Counter)

    def measures(self) -> dict:
        """Return the number of scans by outcome; ``scans`` is the number of all except the `unused` ones."""
        counts = {status.value: self.statuses[status] for status in Status}
        scans = self.skipped + self.ignored + sum(counts.values())
        return {'scans': scans, 'skipped': self.skipped, 'ignored': self.ignored, **counts}

    def __str__(self) -> str:
        counts = [f'{name} {count}' for name, count in self.measures().items() if count or name == 'skipped']
        outside = f', {self.unused} not used, as before or after all scans of the first lidar' if self.unused else ''
        problem = f'; the last skipped: {self.problem}' if self.problem else ''
        error = f'; {self.error}' if self.error else ''
        return ' '.join(counts) + outside + problem + error


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
    """

    def __init__(self, odometry, others, first, mounting, parameters):
        self._odometry, self._first = odometry, Sensor(first, limits=parameters.lidar(first).scan)
        self.recordings = [other.recording for other in others]
        self._others = [(other.sensor(mounting, rank), other.scans(parameters.input_of(other.recording.topic)))
                        for rank, other in enumerate(others, 1)]
        self._next = [next(scans, None) for _, scans in self._others]
        self.counts = {sensor.name: LidarCounts() for sensor in (self._first, *(sensor for sensor, _ in self._others))}
        self._numbers: dict[int, int] = {}

    def process(self, scan):
        """Process the older scans of the other lidars, then a `scan` of the first lidar; return its update."""
        while self._take_older(scan.stamp):
            pass
        update = self._process(scan, self._first)
        number = self._numbers[update.number] = len(self._numbers)
        reference = self._numbers.get(update.reference_number)
        return dataclasses.replace(update, number=number, reference_number=reference)

    def finish(self):
        """Count the scans after the last scan of the first lidar, and name the lidars that disagree."""
        found = self._odometry.comparisons.lidars
        sensors = [self._first, *(sensor for sensor, _ in self._others)]
        for sensor, compared in zip(sensors, disagreeing(
                self._first.pose, [found.get(sensor.name) for sensor in sensors[1:]]), strict=True):
            if compared:
                remedy = ' (see calibrate)' if sensor.rank else ''
                self.counts[sensor.name].error = described(compared, not sensor.rank) + remedy
            elif (lidar := found.get(sensor.name)) and lidar.unfit:
                self.counts[sensor.name].error = UNFIT
        for (sensor, scans), scan in zip(self._others, self._next, strict=True):
            self.counts[sensor.name].unused += (scan is not None) + sum(1 for _ in scans)

    def _take_older(self, stamp):
        """Process the oldest waiting scan of another lidar if it is older than `stamp` [ns]; return if there is one."""
        waiting = [(scan.stamp, k) for k, scan in enumerate(self._next) if scan is not None]
        if not waiting or min(waiting)[0] >= stamp:
            return False
        _, k = min(waiting)
        sensor, scans = self._others[k]
        scan, self._next[k] = self._next[k], next(scans, None)
        if not self._numbers:
            self.counts[sensor.name].unused += 1
            return True
        with suppress(ScanError):
            self._process(scan, sensor)
        return True

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
            counts.ignored += 1
        else:
            counts.statuses[update.status] += 1
        return update
