# SPDX-License-Identifier: Apache-2.0
"""ROS 1 and ROS 2 bags as recordings of scans."""
import math
from collections import Counter
from itertools import islice

import numpy as np

from ...core.errors import RecordingError, ScanError
from ...core.geometry.mounting import Mounting, MountingError
from ...core.scan import Scan, in_nanoseconds
from ...robot.revolution import Revolution
from ...robot.sensors import FRAME_MARK, name_in_frame
from ..checks.scan_checks import ScanFields, ScanWatch
from ..playback import NOT_MEASURED, ODOMETRY, RENAMED, Channel, Played, imu_topic, inputs_of, of_robot, only
from ..poses import PoseError, compose, corrected, planar
from ..recording import Record, Recording
from ..truth import interpolate
from .bag_faults import other_contents
from .clouds import POINT_CLOUD, CloudParameters, CloudReader
from .reading import open_reader, own, safely
from .static_transforms import ancestors, static_mounting

LASER_SCAN = 'sensor_msgs/msg/LaserScan'
CLOUDS_INSTEAD = (f'has point clouds ({POINT_CLOUD}), but laser scans are expected here; replay, compare, tune, '
                  'register and calibrate read point clouds, ros2 bag play sends them to a node, and the ROS package '
                  'pointcloud_to_laserscan makes laser scans of them')
"""How point clouds can be used where they are not read."""
WITHOUT_POINTS = 50
"""A recording is refused if its first point clouds, of this number, have no point between the heights."""


class Bag(Recording):
    """A ROS 1 ``.bag``, or a ROS 2 bag: its folder, or one sqlite3 or mcap file.

    Messages come in order of record time. An odometry topic with *truth* in its name is the ground truth; an odometry
    topic with *laser_pose* in its name contains the poses of the laser. The wheel odometry is the only other odometry
    topic, or the only one of them with *wheel* in its name.

    Parameters
    ----------
    path : Path
    topic : str, optional
        TOPIC:FRAME means the scans on a topic that have this frame.
    point_clouds : CloudParameters, optional
        How point clouds become scans; without it only laser scans can be read. A topic of point clouds is chosen if
        `topic` names it, or no topic has laser scans.
    """

    def __init__(self, path, topic=None, point_clouds: CloudParameters | None = None):
        super().__init__(path)
        name = topic or ''
        topic, frame = name.partition(FRAME_MARK)[::2]
        self._frame: str = frame
        topic = topic or None
        with open_reader(self.path) as reader:
            scans, points, odometry = (_topics(reader.connections, kind)
                                       for kind in (LASER_SCAN, POINT_CLOUD, ODOMETRY))
            self._kinds = {connection.topic: connection.msgtype for connection in reader.connections}
            if point_clouds and (not scans or topic in points):
                scans |= points
            elif topic in points or (points and not scans and topic is None):
                raise RecordingError(f'{self.path}: {topic or ", ".join(points)} {CLOUDS_INSTEAD}')
            if not scans:
                raise RecordingError(f'{self.path}: holds no {LASER_SCAN}; {other_contents(reader.connections)}')
        self._choose(scans, topic)
        self._recorded = self.topic
        self._clouds = point_clouds if self.topic in points else None
        self._reader: CloudReader | None = None
        self._geometry = None
        odometry = of_robot(odometry, self._kinds, self._recorded)
        self._truth_topic = only(name for name in odometry if 'truth' in name)
        self._laser_topic = only(name for name in odometry if 'laser_pose' in name)
        self._wheel_topic = _wheel_topic(odometry)
        if self._frame:
            self._choose_frame(name)
        first = next(self.scans(), None)
        if first is None:
            problem = self.problems[0] if self.problems else 'there is no message'
            raise RecordingError(f'{self.path}: no readable scan on {self.topic}: {problem}')
        self.frame_id = first.frame_id
        if self._reader:
            self.mounting = self._reader.mounting
            if not any(scan.valid.any() for scan in islice(self.scans(), WITHOUT_POINTS)):
                raise RecordingError(f'{self.path}: no point on {self.topic} can be used: {self._reader.problem}')

    def scans(self):
        """Return an iterator over the scans on the chosen topic, in order of record time."""
        return (played.content for played in self.play(()))

    def _choose_frame(self, name):
        """Set `topic` to `name`, TOPIC:FRAME, and count the scans with this frame; raise RecordingError if none is."""
        counts = self._frames()
        if self._frame not in counts:
            raise RecordingError(f'{self.path}: no scans on {self._recorded} have the frame {self._frame!r}; their '
                                 f'frames: {", ".join(counts) or "none"}')
        self.topic, self.count = name, counts[self._frame]
        self.note(f'of the scans on {self._recorded}, those with the frame {self._frame!r}')

    def _frames(self):
        """Return frame -> number of scans on the topic, in the order of their first scans."""
        return Counter(_frame_of(message) for *_, message in self._messages([self._recorded]))

    def lidar_topics(self, base_frame):
        """Return `topic`, or TOPIC:FRAME for each frame of the laser scans, if the mountings of several are recorded.

        The lidar of the first scan is the first one.
        """
        if self._frame or self._clouds or not self._is_mounted(base_frame, self.frame_id):
            return [self.topic]
        frames = self._frames()
        if len(frames) == 1 or not all(self._is_mounted(base_frame, frame) for frame in frames):
            return [self.topic]
        return [name_in_frame(self.topic, frame) for frame in frames]

    def _is_mounted(self, base_frame, frame):
        """Whether the transforms of the bag have the mounting of a lidar with this frame."""
        try:
            return static_mounting(self.path, self._recorded, base_frame, frame) is not None
        except MountingError:
            return False

    def channels(self):
        """Return the `Channel` of every topic that has messages, except the topic of the scans."""
        with open_reader(self.path) as reader:
            held = {c.topic: (c.msgtype, reader.is_latched(c)) for c in reader.connections
                    if c.topic != self._recorded and c.msgcount}
        kinds = {topic: self._kinds[topic] for topic in (*held, self._recorded)}
        inputs = inputs_of(kinds, self._wheel_topic, self._recorded)
        return [Channel(topic, RENAMED.get(kind, kind), latched or inputs.get(topic) == '/tf_static',
                        inputs.get(topic, ''))
                for topic, (kind, latched) in held.items()]

    def play(self, channels):
        """Yield `Played` in order of record time: each readable scan, and each message of `channels` as bytes."""
        watch, revolution = ScanWatch(), Revolution()
        wanted = {channel.recorded: channel for channel in channels}
        for number, topic, time, message in self._messages([self._recorded], wanted):
            if topic in wanted:
                yield Played(message, time, wanted[topic])
                continue
            if self._frame and _frame_of(message) != self._frame:
                continue
            of_cloud = self._cloud_reader(self._clouds, message).check(message) if self._clouds else ()
            self._look(watch, ScanFields.from_message(message), of_cloud)
            yield from self._played(revolution.add(message), number, time)
        if revolution.note:
            self.note(revolution.note)
            yield from self._played(revolution.rest(), number, time)

    def _played(self, messages, number, time):
        """Yield the `Played` of each of the `messages` of scans; `number` of the last one on its topic."""
        for message in messages:
            try:
                scan = self._scan_of(message)
            except ScanError as error:
                self._report(f'{self.path.name}: scan {number} on {self._recorded} skipped: {error}')
                continue
            self._geometry = scan.geometry
            yield Played(scan, time)

    def _scan_of(self, message) -> Scan:
        if not self._clouds:
            return Scan.from_message(message, self._geometry)
        return self._cloud_reader(self._clouds, message).scan(message)

    def _cloud_reader(self, clouds: CloudParameters, message) -> CloudReader:
        self._reader = self._reader or clouds.reader(self.path, self.topic, message.header.frame_id)
        return self._reader

    def records(self):
        """Yield the `Record` of each scan, with the laser pose and the wheel pose interpolated at its stamp."""
        stamps = np.array(self.stamps(), dtype=np.int64)
        robot = _at(stamps, self.wheel_odometry())
        laser = _at(stamps, self._odometry(self._laser_topic or self._truth_topic or self._wheel_topic))
        for scan, laser_pose, robot_pose in zip(self.scans(), laser, robot, strict=True):
            yield Record(scan, laser_pose, robot_pose)

    def wheel_odometry(self):
        """Return stamps ``(N,)`` [ns] and poses ``(N, 3)`` [m, m, rad] of the wheel topic, or None without one."""
        return self._odometry(self._wheel_topic)

    def yaw_rates(self):
        """Return stamps ``(N,)`` [ns] and yaw rates ``(N,)`` [rad/s] of the IMU topic, or None without one.

        Messages without a yaw rate, as ``sensor_msgs/Imu`` marks them, are left out.
        """
        topic = imu_topic({name: self._kinds[name] for name in of_robot(self._kinds, self._kinds, self._recorded)})
        if topic is None:
            return None
        found = [(in_nanoseconds(message.header.stamp), message.angular_velocity.z)
                 for *_, message in self._messages([topic])
                 if message.angular_velocity_covariance[0] != NOT_MEASURED
                 and math.isfinite(message.angular_velocity.z)]
        if not found:
            return None
        return np.array([stamp for stamp, _ in found], dtype=np.int64), np.array([rate for _, rate in found])

    def truth(self):
        """Return stamps and poses of the truth topic, or of the laser topic if its poses were corrected, or None."""
        if self._truth_topic:
            return self._of_lidar(self._odometry(self._truth_topic))
        laser, wheels = self._odometry(self._laser_topic), self.wheel_odometry()
        if laser and wheels and np.array_equal(laser[0], wheels[0]) and corrected(laser[1], wheels[1]):
            return laser
        return None

    def _of_lidar(self, truth):
        """Convert the poses of the frame that the truth names as its child frame to poses of the lidar."""
        message = next((message for *_, message in self._messages([self._truth_topic])), None)
        frame, own_frame = message.child_frame_id.strip('/') if truth else '', self.frame_id.strip('/')
        if not frame or (frame == own_frame and not self._clouds):
            return truth
        reason = '/tf_static has no upright transform between them'
        try:
            mounting = self._mounting_on(frame)
        except MountingError as error:
            mounting, reason = None, str(error)
        if mounting is None or mounting.upside_down:
            self.note(f'{self._truth_topic} has poses of {frame!r}, the lidar is in {own_frame!r}: taken as poses of '
                       f'the lidar, because {reason}')
            return truth
        self.note(f'{self._truth_topic} has poses of {frame!r}: converted by /tf_static to those of {own_frame!r}')
        stamps, poses = truth
        return stamps, compose(poses, mounting.pose.as_array()[None])

    def mounting_on(self, base_frame) -> Mounting:
        """Return the mounting of the lidar by the transforms of the bag; raise a MountingError if they lack it."""
        found = static_mounting(self.path, self._recorded, base_frame, self.frame_id)
        if found is None:
            above = ', '.join(ancestors(self.path, self._recorded, self.frame_id))
            advice = f'; base_frame may be one of the frames above it: {above}' if above else ''
            raise MountingError(f'no transform from {base_frame!r} to {self.frame_id!r} is on /tf_static, and none '
                                f'that is constant on /tf{advice}')
        return found

    def _mounting_on(self, frame) -> Mounting | None:
        """Return the mounting of the scans on another frame; None if it is unknown."""
        if not self._clouds or not self.mounting:
            return static_mounting(self.path, self._recorded, frame, self.frame_id.strip('/'))
        base = static_mounting(self.path, self._recorded, frame, self._clouds.base_frame)
        return base and Mounting(base.pose @ self.mounting.pose, base.upside_down)

    def _odometry(self, topic):
        if topic is None:
            return None
        rows, faults = [], []
        for number, _, _, message in self._messages([topic]):
            p, q = message.pose.pose.position, message.pose.pose.orientation
            try:
                rows.append((in_nanoseconds(message.header.stamp), *planar(p.x, p.y, (q.x, q.y, q.z, q.w))))
            except PoseError as error:
                faults.append(f'pose {number}: {error}')
        if faults:
            self._report(f'{self.path.name}: {len(faults)} of {len(faults) + len(rows)} poses on {topic} skipped; '
                         f'{faults[0]}')
        if not rows:
            return None
        return np.array([row[0] for row in rows], dtype=np.int64), np.array([row[1:] for row in rows], dtype=float)

    def _messages(self, topics, passed=()):
        """Yield number on its topic (from 1), topic, record time [ns] and message; on the topics `passed` as bytes."""
        numbers = Counter()
        with open_reader(self.path) as reader:
            connections = [c for c in reader.connections if c.topic in topics or c.topic in passed]
            for connection, time, raw in safely(reader, connections, self._report):
                topic, kind = connection.topic, connection.msgtype
                numbers[topic] += 1
                try:
                    message = (reader.to_ros2 if topic in passed else reader.deserialize)(raw, RENAMED.get(kind, kind))
                except Exception as error:  # noqa: BLE001 - a damaged message makes the library raise nearly anything
                    self._report(f'{self.path.name}: damaged message {numbers[topic]} on {topic} skipped{own(error)}')
                    continue
                yield numbers[topic], topic, time, message


def _frame_of(message):
    return message.header.frame_id.strip('/')


def _topics(connections, kind):
    """Return topic -> number of messages, for the topics of message type `kind`."""
    counts = Counter()
    for connection in connections:
        if connection.msgtype == kind:
            counts[connection.topic] += connection.msgcount
    return counts


def _wheel_topic(topics):
    """Return the wheel topic: the only one of `topics` without truth or laser poses, or the one with *wheel*."""
    others = [name for name in topics if 'truth' not in name and 'laser_pose' not in name]
    return only(others) or only(name for name in others if 'wheel' in name)


def _at(stamps, trajectory):
    """Return the poses ``(N, 3)`` of a `trajectory` interpolated at `stamps` ``(N,)``; zeros if it is None."""
    if trajectory is None:
        return np.zeros((len(stamps), 3))
    known, poses = trajectory
    if np.array_equal(known, stamps):
        return poses
    return interpolate(known, poses, np.clip(stamps, known.min(), known.max()))
