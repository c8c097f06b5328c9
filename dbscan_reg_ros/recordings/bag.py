"""ROS 1 and ROS 2 bags, read with `rosbags`."""
import math
from collections import Counter
from contextlib import contextmanager

import numpy as np

from ..core.errors import RecordingError, ScanError
from ..core.scan import Scan
from .recording import Recording

LASER_SCAN = 'sensor_msgs/msg/LaserScan'
ODOMETRY = 'nav_msgs/msg/Odometry'


class Bag(Recording):
    """A ROS 1 ``.bag``, or a ROS 2 bag: its folder, or one sqlite3 or mcap file.

    Messages come in order of record time. Odometry topics with *truth* in their name are truth; of the
    others the only one, or the only one with *wheel* in its name, is the wheels'.
    """

    def __init__(self, path, topic=None):
        super().__init__(path)
        self.name = self.path.stem if self.path.is_file() else self.path.resolve().name
        with self._reader() as reader:
            counts = {kind: Counter() for kind in (LASER_SCAN, ODOMETRY)}
            for connection in reader.connections:
                if connection.msgtype in counts:
                    counts[connection.msgtype][connection.topic] += connection.msgcount
        if not counts[LASER_SCAN]:
            raise RecordingError(f'{self.path}: holds no {LASER_SCAN}; record a topic of that type')
        self._choose(counts[LASER_SCAN], topic)
        self._truth_topic = _only(name for name in counts[ODOMETRY] if 'truth' in name)
        others = [name for name in counts[ODOMETRY] if 'truth' not in name]
        self._wheel_topic = _only(others) or _only(name for name in others if 'wheel' in name)
        first = next(self.scans(), None)
        if first is None:
            problem = self.problems[0] if self.problems else 'there is no message'
            raise RecordingError(f'{self.path}: no readable scan on {self.topic}: {problem}')
        self.frame_id = first.frame_id

    def scans(self):
        geometry = None
        for number, message in self._messages(self.topic):
            try:
                scan = Scan.from_message(message, geometry)
            except ScanError as error:
                self._report(f'{self.path.name}: scan {number} on {self.topic} skipped: {error}')
                continue
            geometry = scan.geometry
            yield scan

    def wheel_odometry(self):
        return self._odometry(self._wheel_topic)

    def truth(self):
        return self._odometry(self._truth_topic)

    def _odometry(self, topic):
        if topic is None:
            return None
        rows = [(_stamp(message), *_planar(message.pose.pose)) for _, message in self._messages(topic)]
        stamps = np.array([row[0] for row in rows], dtype=np.int64)
        return stamps, np.array([row[1:] for row in rows], dtype=float).reshape(-1, 3)

    def _messages(self, topic):
        """Number in the topic, counted from 1, and message."""
        with self._reader() as reader:
            connections = [connection for connection in reader.connections if connection.topic == topic]
            messages = reader.messages(connections=connections)
            number = 0
            while True:
                number += 1
                try:
                    connection, _, raw = next(messages)
                except StopIteration:
                    return
                except Exception as error:  # noqa: BLE001 - a damaged bag makes its reader raise nearly anything
                    self._report(f'{self.path.name}: cannot be read from message {number} on {topic} on: '
                                 f'{describe(error)}')
                    return
                try:
                    message = reader.deserialize(raw, connection.msgtype)
                except Exception as error:  # noqa: BLE001 - as above
                    self._report(f'{self.path.name}: damaged message {number} on {topic} skipped: {describe(error)}')
                    continue
                yield number, message

    @contextmanager
    def _reader(self):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
        try:
            reader = AnyReader([self.path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
            reader.open()
        except Exception as error:
            raise RecordingError(f'{self.path}: cannot be read as a bag: {describe(error)}') from error
        try:
            yield reader
        finally:
            reader.close()


def describe(error):
    """An exception in one line."""
    return ' '.join(str(error).split()) or type(error).__name__


def _only(names):
    names = list(names)
    return names[0] if len(names) == 1 else None


def _stamp(message):
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


def _planar(pose):
    """x, y [m] and heading [rad] of a message's pose."""
    q = pose.orientation
    return (pose.position.x, pose.position.y,
            math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z)))
