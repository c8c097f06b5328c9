# SPDX-License-Identifier: Apache-2.0
"""What the tests use of `rosbag2_py`, which is not on PyPI; real sqlite3 bags, by Python's own sqlite3.

Names, arguments and results are those of ROS 2 Jazzy; `test_rosbag2.py` has their list. Whatever the storage that is
asked for, it writes sqlite3, and it reads nothing else.
"""
import sqlite3
from contextlib import closing
from pathlib import Path

import yaml

from ._storage import BagMetadata, ConverterOptions, StorageFilter, StorageOptions, TopicMetadata

__all__ = ['ConverterOptions', 'Info', 'SequentialCompressionReader', 'SequentialReader', 'SequentialWriter',
           'StorageFilter',
           'StorageOptions', 'TopicMetadata']

TABLES = ('CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, '
          'serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL, '
          'type_description_hash TEXT NOT NULL)',
          'CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, '
          'data BLOB NOT NULL)')


class Info:
    def __init__(self):
        pass

    def read_metadata(self, arg0, arg1):
        path = Path(arg0)
        return BagMetadata(path if path.is_dir() else path.parent)


class SequentialReader:
    def __init__(self):
        self._messages = None

    def open(self, arg0, arg1):
        assert isinstance(arg1, ConverterOptions)
        path = Path(arg0.uri)
        metadata = Info().read_metadata(str(path), arg0.storage_id)
        self._files = metadata.files if path.is_dir() else [path]
        if metadata.storage_identifier != 'sqlite3':
            raise RuntimeError('No storage could be initialized from the inputs.')
        self.set_filter(StorageFilter())

    def set_filter(self, arg0):
        self._messages = self._read(arg0.topics)
        self._next = next(self._messages, None)

    def _read(self, topics):
        for file in self._files:
            try:
                with closing(sqlite3.connect(file)) as base:
                    rows = base.execute('SELECT name, data, timestamp FROM messages JOIN topics ON topic_id = '
                                        'topics.id '
                                        'ORDER BY timestamp, messages.id').fetchall()
            except sqlite3.Error as error:
                raise RuntimeError(f'Error when preparing SQL statement: {error}') from error
            yield from (row for row in rows if not topics or row[0] in topics)

    def has_next(self):
        return self._next is not None

    def read_next(self):
        message, self._next = self._next, next(self._messages, None)
        return message


class SequentialCompressionReader(SequentialReader):
    pass


class SequentialWriter:
    def __init__(self):
        self._topics, self._base = {}, None

    def open(self, arg0, arg1):
        assert isinstance(arg1, ConverterOptions)
        self._folder = Path(arg0.uri)
        if self._folder.exists():
            raise RuntimeError(f'Bag directory already exists ({self._folder}), can\'t overwrite existing bag')
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
        if arg0 not in self._topics:
            raise RuntimeError('Topic has not been created yet! Call \'create_topic\' first.')
        self._base.execute('INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)',
                           (self._topics[arg0][0], arg2, arg1))

    def close(self):
        if self._base:
            self._base.commit()
            (self._folder
             / 'metadata.yaml').write_text(yaml.safe_dump({'rosbag2_bagfile_information': self._described()}))
            self._base.close()
            self._base = None

    def _described(self):
        counts = dict(self._base.execute('SELECT topic_id, count(*) FROM messages GROUP BY topic_id').fetchall())
        first, last = self._base.execute('SELECT min(timestamp), max(timestamp) FROM messages').fetchone()
        span = {'starting_time': {'nanoseconds_since_epoch': first or 0},
                'duration': {'nanoseconds': (last or 0) - (first or 0)},
                'message_count': sum(counts.values())}
        topics = [{'message_count': counts.get(number, 0),
                   'topic_metadata': {'name': topic.name, 'type': topic.type, 'type_description_hash': '',
                                      'serialization_format': topic.serialization_format,
                                      'offered_qos_profiles': [_profile(each) for each in topic.offered_qos_profiles]}}
                  for number, topic in self._topics.values()]
        return {'version': 9, 'storage_identifier': 'sqlite3', 'compression_format': '', 'compression_mode': '',
                'relative_file_paths': [self._file], 'files': [{'path': self._file, **span}],
                'topics_with_message_count': topics,
                'custom_data': None, 'ros_distro': 'jazzy', **span}


def _profile(quality):
    forever = {'sec': 9223372036, 'nsec': 854775807}
    return {'deadline': forever, 'lifespan': forever, 'liveliness': 1, 'liveliness_lease_duration': forever,
            'avoid_ros_namespace_conventions': False, **quality.described}
