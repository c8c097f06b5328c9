# SPDX-License-Identifier: Apache-2.0
"""ROS 1 and ROS 2 bags, read and written with `rosbags`."""
import contextlib
import io
from bz2 import BZ2Decompressor
from functools import cache
from types import SimpleNamespace

import numpy as np
from lz4.frame import LZ4FrameDecompressor
from rosbags import rosbag1, rosbag2
from rosbags.convert.converter import create_connections_converters
from rosbags.highlevel import AnyReader
from rosbags.interfaces import (
    MessageDefinitionFormat,
    Nodetype,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import reader as reader1
from rosbags.rosbag2 import reader as reader2
from rosbags.rosbag2 import storage_mcap as mcap
from rosbags.typesys import Stores, TypesysError, get_typestore

from ...core.errors import RecordingError
from ..playback import TRANSFORMS

NO_HASH = f'RIHS01_{"0" * 64}'
"""Written for a type whose definition and hash are unknown."""
FOREVER = QosTime(2147483647, 4294967295)
LATCHED = Qos(QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL, FOREVER, FOREVER,
              QosLiveliness.AUTOMATIC, FOREVER, False)
"""Quality of service with which late subscribers receive a topic that is published once."""


@cache
def _types(version):
    """Return the message types of a ROS version; the code that reads and writes each of them is generated once."""
    types = get_typestore(version)
    if version is Stores.ROS1_NOETIC:
        # They lack the type of /tf_static, which ROS 2 has not changed.
        types.register({TRANSFORMS: _types(Stores.ROS2_JAZZY).fielddefs[TRANSFORMS]})
    return types


class BagReader:
    """An open bag.

    Parameters
    ----------
    path : Path
        Path of a ROS 1 bag, of the folder of a ROS 2 bag, or of one file in that folder.

    Attributes
    ----------
    path : Path
    is_ros2 : bool
    connections : list
        One connection for each topic, message type and publisher, with the fields `topic`, `msgtype` and `msgcount`.
    message_count : int
    start_time, duration : int
        First record time and span of the record times [ns].
    faults : list of str
        A line about each file of the bag that is missing or damaged.
    """

    def __init__(self, path):
        limit_decompression()
        self.path = path
        self.faults: list[str] = []
        self.is_ros2 = path.suffix != '.bag'
        # Not with AnyReader, which parses the definitions of all messages: standard ones are used here.
        self._reader = (rosbag2 if self.is_ros2 else rosbag1).Reader(path)
        self._reader.open()
        self._store = _types(Stores.ROS2_JAZZY if self.is_ros2 else Stores.ROS1_NOETIC)
        self.connections = self._reader.connections
        self.message_count, self.start_time = self._reader.message_count, self._reader.start_time
        self.duration = self._reader.end_time - self.start_time

    def close(self):
        """Close the files of the bag."""
        self._reader.close()

    def messages(self, connections, start=None, stop=None):
        """Return Connection, record time [ns] and bytes of each message recorded in [`start`, `stop`) [ns]."""
        return self._reader.messages(connections, start, stop)

    def deserialize(self, raw, kind):
        """Return the message of type `kind`, decoded with the standard definition of the type, not that of the file."""
        return self._store.deserialize_cdr(raw, kind) if self.is_ros2 else self._store.deserialize_ros1(raw, kind)

    def is_latched(self, connection):
        """Whether late subscribers receive the topic."""
        if self.is_ros2:
            return any(each.durability == QosDurability.TRANSIENT_LOCAL for each in connection.ext.offered_qos_profiles)
        return bool(connection.ext.latching)

    def to_ros2(self, raw, kind):
        """Return a message as the bytes that ROS 2 sends, with the standard definition of its type."""
        return bytes(raw if self.is_ros2 else _types(Stores.ROS2_JAZZY).ros1_to_cdr(raw, kind))


@contextlib.contextmanager
def _with_definitions(path):
    """Provide a reader of the bag at `path` that knows the definitions of its messages."""
    reader = AnyReader([path], default_typestore=_types(Stores.ROS2_JAZZY))
    try:
        reader.open()
    except Exception as error:
        raise RecordingError(f'{path}: the definitions of its message types cannot be read, and without them it cannot '
                             'be converted to another version of ROS; copy a part of it first (convert --topics)'
                             ) from error
    with contextlib.closing(reader):
        yield reader


class BagWriter:
    """A bag that is written within a ``with`` statement: ``NAME.bag`` is a ROS 1 bag, any other `target` a ROS 2 bag.

    `storage` is that of a ROS 2 bag: ``mcap`` or ``sqlite3``.
    """

    def __init__(self, target, storage):
        self._ros1 = target.suffix == '.bag'
        self._writer = (rosbag1.Writer(target) if self._ros1 else
                        rosbag2.Writer(target, version=9, storage_plugin=rosbag2.StoragePlugin[storage.upper()]))
        self._store = get_typestore(Stores.ROS1_NOETIC if self._ros1 else Stores.ROS2_JAZZY)

    def __enter__(self):
        self._writer.__enter__()
        return self

    def __exit__(self, *error):
        return self._writer.__exit__(*error)

    def add_topic(self, topic, kind, latched=False):
        """Add a topic of type `kind`, `latched` for late subscribers; return the handle to pass to `write`."""
        options = {'offered_qos_profiles': [LATCHED]} if latched and not self._ros1 else {}
        return self._writer.add_connection(topic, kind, typestore=self._store, **options)

    def add_topics_of(self, reader, connections):
        """Add the topics of a `BagReader`; return a function from connection and bytes to the arguments of `write`."""
        if reader.is_ros2 != self._ros1:
            added = {(each.id, each.owner): self._copied(each) for each in connections}
            return lambda connection, raw: (added[connection.id, connection.owner], raw)
        try:
            with contextlib.redirect_stdout(io.StringIO()), _with_definitions(reader.path) as definitions:
                written, converted = create_connections_converters(connections, self._store, definitions, self._writer)
        except TypesysError as error:
            lacking = ', '.join(f'{each.topic} ({each.msgtype})' for each in connections
                                if each.msgtype not in self._store.fielddefs)
            raise RecordingError(f'{reader.path}: another version of ROS needs the definition of each type, and '
                                 f'one of these has none: {lacking}; leave out its topic (--topics)') from error
        return lambda connection, raw: (written[connection.id, connection.owner], converted[connection.msgtype](raw))

    def _copied(self, connection):
        """Add a topic with the type, definition and quality of service that it has in a bag of the same version."""
        kind, known = connection.msgtype, connection.msgtype in self._store.fielddefs
        is_given = connection.msgdef.format != MessageDefinitionFormat.NONE
        if self._ros1:
            fields = {'md5sum': connection.digest, **connection.ext._asdict()}
        else:
            fields = {'rihs01': connection.digest or (self._store.hash_rihs01(kind) if known else NO_HASH),
                      **connection.ext._asdict()}
        definition = (connection.msgdef.data if is_given else
                      self._store.generate_msgdef(kind, ros_version=2)[0] if known else '')
        same = (each for each in self._writer.connections
                if (each.topic, each.msgtype, each.ext) == (connection.topic, kind, connection.ext))
        return next(same, None) or self._writer.add_connection(connection.topic, kind, msgdef=definition, **fields)

    def write(self, topic, time, raw):
        """Write the bytes of a message with its record time [ns]."""
        self._writer.write(topic, time, raw)


def serializer(target):
    """Return the function from type and fields to the bytes of a message, in the format of the bag `target`.

    Fields that are left out are zero, empty, or the identity quaternion.
    """
    maker = MessageMaker()
    if target.suffix != '.bag':
        return maker.serialize
    return lambda kind, fields: maker.store.cdr_to_ros1(maker.serialize(kind, fields), kind)


LIMIT = 64 * 2**20
"""Maximum size of one unpacked chunk or message of a bag [bytes]."""


def limit_decompression():
    """Make `rosbags` unpack at most `LIMIT` bytes at a time for the rest of this process."""
    zstd = mcap.zstd
    unpack_lz4, unpack_zstd = limited(LZ4FrameDecompressor), limited(zstd.ZstdDecompressor)
    reader1.decompressors.update(bz2=limited(BZ2Decompressor), lz4=unpack_lz4)
    mcap.DECOMPRESSORS.update(lz4=unpack_lz4, zstd=unpack_zstd)
    reader2.zstd = SimpleNamespace(open=zstd.open, decompress=unpack_zstd)


def limited(decompressor):
    """Return a function that unpacks bytes with the streams that ``decompressor()`` makes.

    The function raises RecordingError when there are more than `LIMIT` unpacked bytes, or the packed bytes end too
    early.
    """

    def unpack(packed, _size=None):
        parts, rest = [], LIMIT
        while packed:
            stream = decompressor()
            parts.append(stream.decompress(packed, rest + 1))
            rest -= len(parts[-1])
            if rest < 0:
                raise RecordingError(f'a compressed part holds more than {LIMIT} bytes; expected chunks of a few MB')
            if not stream.eof:
                raise RecordingError('a compressed part ends too early')
            packed = stream.unused_data
        return b''.join(parts)

    return unpack


BYTES = dict.fromkeys(('octet', 'byte', 'char'), 'uint8')
"""Type in a definition that numpy has under another name."""
EMPTY = {'string': '', 'bool': False, 'float32': 0.0, 'float64': 0.0}


class MessageMaker:
    """Makes serialised ROS 2 messages; its `store` has the message types of ROS 2 Jazzy."""

    def __init__(self):
        self.store = get_typestore(Stores.ROS2_JAZZY)
        self._members = cache(self._members)

    def serialize(self, kind, fields):
        """Return the message of type `kind`, such as ``nav_msgs/msg/Odometry``, as CDR, from nested `fields`.

        Fields left out are zero, empty, or the identity rotation.
        """
        return self.store.serialize_cdr(self._make(kind, fields), kind)

    def _make(self, kind, fields):
        message, members, parts = self._members(kind)
        if parts:
            fields = {name: self._part(parts[name], value) if name in parts else value
                      for name, value in fields.items()}
        return message(**(members | fields))

    def _part(self, kind, value):
        return [self._make(kind, item) for item in value] if isinstance(value, list) else self._make(kind, value)

    def _members(self, kind):
        """Return the class of a message type, the default of every field, and the type of each nested message field."""
        defaults, parts = {}, {}
        for name, (node, detail) in self.store.fielddefs[kind][1]:
            if node == Nodetype.BASE:
                defaults[name] = EMPTY.get(detail[0], 0)
            elif node == Nodetype.NAME:
                parts[name] = detail
                defaults[name] = self._make(detail, {})
            else:
                (element, what), length = detail
                length = length if node == Nodetype.ARRAY else 0
                if element == Nodetype.NAME:
                    parts[name] = what
                    defaults[name] = [self._make(what, {}) for _ in range(length)]
                elif what[0] == 'string':
                    defaults[name] = [''] * length
                else:
                    defaults[name] = np.zeros(length, dtype=BYTES.get(what[0], what[0]))
        if kind == 'geometry_msgs/msg/Quaternion':
            defaults['w'] = 1.0
        return self.store.types[kind], defaults, parts
