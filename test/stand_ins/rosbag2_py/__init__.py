# SPDX-License-Identifier: Apache-2.0
"""What the package uses of `rosbag2_py`, which is not on PyPI; real sqlite3 bags, by Python's own sqlite3.

Names, arguments and results are those of ROS 2 Jazzy. Whatever the storage, it writes and reads sqlite3.
"""
import sqlite3
import sys
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import yaml
from rclpy.duration import Duration
from rclpy.time import Time

TABLES = ('CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, '
          'serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL, '
          'type_description_hash TEXT NOT NULL)',
          'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, '
          'data BLOB NOT NULL)')
ROWS = ('SELECT name, data, timestamp FROM messages JOIN topics ON topic_id = topics.id '
        'ORDER BY timestamp, messages.id')
FOREVER = {'sec': 9223372036, 'nsec': 854775807}


class ConverterOptions(SimpleNamespace):
    def __init__(self, input_serialization_format='', output_serialization_format=''):
        super().__init__()


class StorageOptions(SimpleNamespace):
    def __init__(self, uri, storage_id=''):
        super().__init__(uri=uri, storage_id=storage_id)


class StorageFilter(SimpleNamespace):
    def __init__(self, topics=()):
        super().__init__(topics=list(topics))


class TopicMetadata(SimpleNamespace):
    def __init__(self, id, name, type, serialization_format, offered_qos_profiles=()):
        super().__init__(name=name, type=type, serialization_format=serialization_format,
                         offered_qos_profiles=list(offered_qos_profiles))


class QoS:
    """The numbers are those of ``rmw_qos_reliability_policy_t`` and ``rmw_qos_durability_policy_t``."""

    def __init__(self, history_depth):
        self.described = {'history': 1, 'depth': history_depth, 'reliability': 1, 'durability': 2, 'liveliness': 1,
                          'deadline': FOREVER, 'lifespan': FOREVER, 'liveliness_lease_duration': FOREVER,
                          'avoid_ros_namespace_conventions': False}

    def reliable(self):
        return self

    def transient_local(self):
        self.described['durability'] = 1
        return self


class Info:
    def read_metadata(self, arg0, arg1):
        path = Path(arg0)
        folder = path if path.is_dir() else path.parent
        described = yaml.safe_load((folder / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
        topics = [SimpleNamespace(topic_metadata=TopicMetadata(0, **_without_hash(each['topic_metadata'])),
                                  message_count=each['message_count'])
                  for each in described['topics_with_message_count']]
        return SimpleNamespace(
            compression_mode=described['compression_mode'], message_count=described['message_count'],
            files=[folder / name for name in described['relative_file_paths']] if path.is_dir() else [path],
            starting_time=Time(nanoseconds=described['starting_time']['nanoseconds_since_epoch']),
            duration=Duration(nanoseconds=described['duration']['nanoseconds']), topics_with_message_count=topics)


def _without_hash(described):
    qualities = []
    for each in described['offered_qos_profiles']:
        qualities.append(QoS(each['depth']))
        qualities[-1].described = each
    return {name: described[name] for name in ('name', 'type', 'serialization_format')} | {
        'offered_qos_profiles': qualities}


class SequentialReader:
    def open(self, arg0, arg1):
        self._files = Info().read_metadata(arg0.uri, arg0.storage_id).files
        self.set_filter(StorageFilter())

    def set_filter(self, arg0):
        rows = [row for file in self._files for row in _rows(file)]
        self._messages = [row for row in rows[::-1] if not arg0.topics or row[0] in arg0.topics]

    def has_next(self):
        return bool(self._messages)

    def read_next(self):
        return self._messages.pop()


SequentialCompressionReader = SequentialReader


def _rows(file):
    with closing(sqlite3.connect(file)) as base:
        return base.execute(ROWS).fetchall()


class SequentialWriter:
    def open(self, arg0, arg1):
        self._topics, self._folder = {}, Path(arg0.uri)
        self._folder.mkdir()
        self._file = f'{self._folder.name}_0.db3'
        self._base = sqlite3.connect(self._folder / self._file, isolation_level='DEFERRED')
        for table in TABLES:
            self._base.execute(table)

    def create_topic(self, arg0):
        number = len(self._topics) + 1
        self._topics[arg0.name] = number, arg0
        self._base.execute('INSERT INTO topics VALUES(?, ?, ?, ?, ?, ?)',
                           (number, arg0.name, arg0.type, arg0.serialization_format, '', ''))

    def write(self, arg0, arg1, arg2):
        assert isinstance(arg1, bytes) and isinstance(arg2, int)
        self._base.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)',
                           (self._topics[arg0][0], arg2, arg1))

    def close(self):
        self._base.commit()
        counts = dict(self._base.execute('SELECT topic_id, count(*) FROM messages GROUP BY topic_id').fetchall())
        first, last = self._base.execute('SELECT min(timestamp), max(timestamp) FROM messages').fetchone()
        self._base.close()
        span = {'starting_time': {'nanoseconds_since_epoch': first or 0},
                'duration': {'nanoseconds': (last or 0) - (first or 0)}, 'message_count': sum(counts.values())}
        topics = [{'message_count': counts.get(number, 0), 'topic_metadata': vars(topic) | {
            'type_description_hash': '',
            'offered_qos_profiles': [each.described for each in topic.offered_qos_profiles]}}
            for number, topic in self._topics.values()]
        described = {'version': 9, 'storage_identifier': 'sqlite3', 'compression_format': '', 'compression_mode': '',
                     'relative_file_paths': [self._file], 'files': [{'path': self._file, **span}],
                     'topics_with_message_count': topics, 'custom_data': None, 'ros_distro': 'jazzy', **span}
        (self._folder / 'metadata.yaml').write_text(yaml.safe_dump({'rosbag2_bagfile_information': described}))


sys.modules[f'{__name__}._storage'] = sys.modules[__name__]
