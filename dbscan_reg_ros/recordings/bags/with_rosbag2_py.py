# SPDX-License-Identifier: Apache-2.0
"""ROS 2 bags, read and written with `rosbag2_py`, which every ROS 2 Jazzy has; same interface as `with_rosbags`."""
from typing import NamedTuple

import rosbag2_py

from ...core.errors import RecordingError
from ..message_fields import filled, message_class
from .bag_faults import kind_at

COMPRESSED = ('file', 'message')
"""Values of `compression_mode` for which a bag needs the reader of compressed bags."""


class Connection(NamedTuple):
    """A topic of a bag."""

    topic: str
    msgtype: str
    msgcount: int
    qualities: list


class BagReader:
    """An open ROS 2 bag, its folder or one of its files, with the attributes of `with_rosbags.BagReader`."""

    def __init__(self, path):
        self.path = path
        self.faults: list[str] = []
        self._storage = kind_at(path) or ''
        metadata = rosbag2_py.Info().read_metadata(str(path), self._storage)
        self._compressed = path.is_dir() and metadata.compression_mode.lower() in COMPRESSED
        self._open()
        self.connections = [
            Connection(each.topic_metadata.name, each.topic_metadata.type, each.message_count,
                       each.topic_metadata.offered_qos_profiles) for each in metadata.topics_with_message_count]
        self.message_count = metadata.message_count
        self.start_time, self.duration = metadata.starting_time.nanoseconds, metadata.duration.nanoseconds

    def _open(self):
        reader = rosbag2_py.SequentialCompressionReader() if self._compressed else rosbag2_py.SequentialReader()
        reader.open(rosbag2_py.StorageOptions(uri=str(self.path), storage_id=self._storage), _as_they_are())
        return reader

    def close(self):
        """Do nothing: each pass has its own reader, which closes its files when it is deleted."""

    def messages(self, connections, start=None, stop=None):
        """Yield Connection, record time [ns] and bytes of each message recorded in [`start`, `stop`) [ns]."""
        wanted = {connection.topic: connection for connection in connections}
        if not wanted:
            return
        reader = self._open()
        reader.set_filter(rosbag2_py.StorageFilter(topics=list(wanted)))
        while reader.has_next():
            topic, raw, time = reader.read_next()
            if (start is None or time >= start) and (stop is None or time < stop):
                yield wanted[topic], time, raw

    def deserialize(self, raw, kind):
        """Return the message of type `kind`, as the installed ROS defines that type."""
        from rclpy.serialization import deserialize_message
        return deserialize_message(bytes(raw), message_class(kind))

    def is_latched(self, _connection):
        """Whether late subscribers receive the topic: False, since Jazzy's Python cannot read the QoS of a bag."""
        return False

    def to_ros2(self, raw, kind):
        """Return a message as the bytes that ROS 2 sends."""
        return bytes(raw)


class BagWriter:
    """A ROS 2 bag that is written within a ``with`` statement; same interface as `with_rosbags.BagWriter`."""

    def __init__(self, target, storage):
        self._target, self._storage = target, storage
        self._topics = 0

    def __enter__(self):
        self._writer = rosbag2_py.SequentialWriter()
        try:
            options = rosbag2_py.StorageOptions(uri=str(self._target), storage_id=self._storage)
            self._writer.open(options, _as_they_are())
        except RuntimeError as error:
            raise RecordingError(f'{self._target}: cannot be written by rosbag2 as {self._storage}: {error}') from error
        return self

    def __exit__(self, *_):
        self._writer.close()

    def add_topic(self, topic, kind, latched=False):
        """Add a topic of type `kind`, `latched` for late subscribers; return the handle to pass to `write`."""
        from rosbag2_py._storage import QoS
        return self._add(topic, kind, [QoS(1).reliable().transient_local()] if latched else [])

    def _add(self, topic, kind, qualities):
        self._writer.create_topic(rosbag2_py.TopicMetadata(
            id=self._topics, name=topic, type=kind, serialization_format='cdr', offered_qos_profiles=qualities))
        self._topics += 1
        return topic

    def add_topics_of(self, _reader, connections):
        """Add the topics of a `BagReader`; return a function from connection and bytes to the arguments of `write`."""
        for connection in connections:
            self._add(connection.topic, connection.msgtype, connection.qualities)
        return lambda connection, raw: (connection.topic, raw)

    def write(self, topic, time, raw):
        """Write the bytes of a message with its record time [ns]."""
        self._writer.write(topic, bytes(raw), int(time))


def serializer(_target):
    """Return the function from type and fields to the bytes of a message.

    Fields that are left out are zero, empty, or the identity rotation.
    """
    from rclpy.serialization import serialize_message
    return lambda kind, fields: serialize_message(filled(message_class(kind)(), fields))


def _as_they_are():
    return rosbag2_py.ConverterOptions(input_serialization_format='cdr', output_serialization_format='cdr')
