# SPDX-License-Identifier: Apache-2.0
"""Several lidars of one recording: their topics, mountings and scans."""
import math
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import NamedTuple

from ..core.errors import RecordingError
from ..core.geometry.mounting import Mounting, MountingError
from ..core.geometry.se2 import SE2
from ..core.parameters.features import ScanParameters
from ..core.scan import Scan
from ..core.scan_geometry import ScanGeometry
from ..core.sensor import Sensor
from ..recordings import open_recording
from ..recordings.bags.clouds import CloudParameters
from ..recordings.recording import Recording
from ..robot.mask import Mask, corrected_stamp
from ..robot.parameter_groups import InputParameters
from ..robot.parameters import mounting_from_parameters
from ..robot.scan_buffer import OfLidar, RecordedScans
from ..robot.sensors import NAMELESS

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
    """The lidars of recordings, as the user names them."""

    topics: tuple[str, ...] = ()
    """Topics of the scans, that of the first lidar first; empty if the recordings have only one."""
    mountings: dict = field(default_factory=dict)
    """Topic -> `Mounting`, for the mountings that the user gave."""

    @property
    def first(self) -> str | None:
        """Topic of the first lidar, whose poses are estimated; None if the recordings have only one."""
        return self.topics[0] if self.topics else None

    def words(self) -> list:
        """Return the words of a command line that name these lidars; none for a single lidar."""
        if len(self.topics) <= 1:
            return []
        mountings = [['--mounting', topic, *(f'{value:.9f}' for value in (
            mounting.pose.x, mounting.pose.y, math.degrees(mounting.pose.theta))),
            *([UPSIDE_DOWN] if mounting.upside_down else [])] for topic, mounting in self.mountings.items()]
        return [*chain(*mountings, *(['--topic', topic] for topic in self.topics))]

    def of_recording(self, path, parameters) -> 'Lidars':
        """Return the lidars of the recording at `path`: those of one topic, in several frames, are lidars of their own.

        This applies to topics whose ``mounting`` is tf in the `parameters` (`NodeParameters`), and to which the user
        gave no mounting.
        """
        topics: list[str] = []
        for topic in self.topics or (None,):
            recording = open_recording(path, topic, CloudParameters.of(parameters, topic, self.mountings))
            is_given = recording.topic in self.mountings or parameters.lidar(recording.topic).mounting != 'tf'
            topics += [recording.topic] if is_given else recording.lidar_topics(parameters.base_frame)
        return replace(self, topics=tuple(topics)) if len(topics) > max(len(self.topics), 1) else self

    def open(self, path, parameters) -> Recording:
        """Open the recording at `path` with the topic of the first lidar; point clouds as in `parameters`."""
        return open_recording(path, self.first, CloudParameters.of(parameters, self.first, self.mountings))


def mounting_in(recording: Recording, mountings, base_frame, option='--mounting {} X Y DEG, or ') -> Mounting:
    """Return the mounting of the lidar of a `recording`: the mounting given for its topic, else the recorded one.

    `option` begins the advice in the error; it is empty for a command without this option. Raises a MountingError when
    the mounting is neither given nor recorded.
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
class RecordedLidar:
    """A lidar of a recording."""

    recording: Recording
    """Recording with the topic of this lidar."""
    mounting: Mounting
    limits: ScanParameters | None
    """Limits of its ranges and of its range noise; None for a single lidar."""

    def sensor(self, first: Mounting, rank: int) -> Sensor:
        """Return the `Sensor` of the scans of this lidar, which are rotated by the yaw of its mounting."""
        offset = first.aligned_pose.inverse() @ self.mounting.aligned_pose
        return Sensor(self.recording.topic, offset, rank, self.limits)

    def scans(self, parameters: InputParameters):
        """Yield the scans of this lidar without masked returns, rotated to the axes of the base."""
        return prepared(self.recording.scans(), self.mounting, parameters, self.recording.note)

    def measured(self, parameters):
        """Return the scans in the frame of this lidar; of one of several without masked returns, and as if upright.

        Then `parameters` (`NodeParameters`) have its mask and its time offset.
        """
        scans = self.recording.scans()
        if self.limits is None:
            return scans
        return turned(received(scans, parameters.input_of(self.recording.topic)), 0.0, self.mounting.upside_down)


def given_mountings(parameters, topics) -> dict:
    """Return topic -> `Mounting` of those of several lidars whose poses the `parameters` (`NodeParameters`) contain."""
    if len(topics) <= 1 or parameters.sensors == NAMELESS:
        return {}
    found = {topic: mounting_from_parameters(parameters.lidar(topic)) for topic in topics}
    return {topic: mounting for topic, mounting in found.items() if mounting}


def further_lidars(first: Recording, topics, mountings, parameters) -> list:
    """Open the other `topics` of the recording `first`; return a `RecordedLidar` for each.

    Raises a RecordingError when a topic is given twice or holds no scans, and a MountingError when the mounting of a
    lidar is not known.
    """
    if len({first.topic, *topics}) <= len(topics):
        raise RecordingError(f'{first.path}: expected each topic once: {", ".join((first.topic, *topics))}')
    opened = [open_recording(first.path, topic, CloudParameters.of(parameters, topic, mountings)) for topic in topics]
    return [RecordedLidar(recording, mounting_in(recording, mountings, parameters.base_frame),
                         parameters.lidar(recording.topic).scan) for recording in opened]


def lidars_of(first: Recording, lidars: Lidars, parameters, base=False) -> tuple:
    """Return the mounting of the lidar of the recording `first`, and a `RecordedLidar` for each of the other `lidars`.

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


def mounting_of(parameters) -> Mounting:
    """Return the mounting in `parameters` (`LidarParameters`); identity with ``mounting: tf``."""
    return mounting_from_parameters(parameters) or Mounting()


def received(scans, parameters, note=None):
    """Yield `scans` as the node uses them: the stamps corrected by ``input.time_offset``, without masked returns.

    `parameters` are the `InputParameters` of this lidar; `note` is called with a sentence on a fault of the mask.
    """
    mask, (offset,) = Mask(), parameters.time_offset
    for scan in scans:
        if offset:
            scan = replace(scan, stamp=corrected_stamp(scan.stamp, offset))
        scan = mask.apply(scan, Mounting(), parameters)
        if note and mask.fault:
            note(mask.fault)
        yield scan


def turned(scans, yaw, upside_down=False):
    """Yield `scans` of a laser with the mounting angle `yaw` [rad], rotated so that their x axis is that of the base.

    Scans of a laser that is mounted upside down are converted to those of an upright laser with the same x axis.
    """
    geometry, sign = None, -1.0 if upside_down else 1.0
    for scan in scans:
        if yaw or upside_down:
            g = scan.geometry
            rotated = ScanGeometry(sign * g.angle_min + yaw, sign * g.angle_increment, g.size, g.range_min, g.range_max)
            geometry = rotated.reuse(geometry)
            scan = Scan(scan.stamp, scan.ranges, geometry, scan.time_increment, scan.frame_id)
        yield scan


def prepared(scans, mounting, parameters, note=None):
    """Yield `scans` of a lidar as the odometry processes them: `received` with `parameters`, and `turned`."""
    return turned(received(scans, parameters, note), mounting.pose.theta, mounting.upside_down)


def all_lidars(path, lidars, parameters) -> list:
    """Open the recording at `path` for each of the `lidars` (`Lidars`); return a `RecordedLidar` for each.

    `parameters` are `NodeParameters`. Raises as `further_lidars`.
    """
    lidars = lidars.of_recording(path, parameters)
    if len(lidars.topics) <= 1:
        own = CloudParameters.of(parameters, lidars.first)
        return [RecordedLidar(open_recording(path, lidars.first, own), Mounting(), None)]
    recording = lidars.open(path, parameters)
    mounting, others = lidars_of(recording, lidars, parameters)
    return [RecordedLidar(recording, mounting, parameters.lidar(recording.topic).scan), *others]


class Found(NamedTuple):
    """Scans that `find_scans` found."""

    scans: dict
    """Number of a wanted scan among those of all lidars -> `OfLidar`."""
    around: list[dict]
    """For each lidar, the number of a scan among its own -> scan: the wanted scans and their neighbours."""
    read: int
    """Number of scans that were read."""


def find_scans(streams, numbers) -> Found:
    """Read the scans of all lidars in the order of `RecordedScans` until those with these `numbers` are found.

    The scans before and after each of them, of the same lidar, are returned as well.
    """
    found: dict[int, OfLidar] = {}
    last: dict[int, OfLidar] = {}
    around: list[dict[int, Scan]] = [{} for _ in streams]
    read = 0
    for number, each in enumerate(RecordedScans(streams).before()):
        read, previous = number + 1, last.get(each.lidar)
        last[each.lidar] = each
        if number in numbers:
            found[number] = each
        if number in numbers or previous in found.values():
            around[each.lidar].update({one.own: one.scan for one in (previous, each) if one})
        if number > max(numbers) and all(one.own + 1 in around[one.lidar] for one in found.values()):
            break
    return Found(found, around, read)
