# SPDX-License-Identifier: Apache-2.0
"""Format of a bag, reasons why it cannot be opened, and the remedies, from the first and last bytes of its files."""
import shlex
from pathlib import Path
from typing import NamedTuple

KINDS = {b'\x89MCAP0\r\n': 'mcap', b'SQLite format 3\0': 'sqlite3', b'#ROSBAG ': 'ROS 1 bag'}
"""First bytes of a bag file -> its format."""
ENDINGS = {'mcap': '.mcap', 'sqlite3': '.db3', 'ROS 1 bag': '.bag'}
PACKED = {b'\x28\xb5\x2f\xfd': ('zstd', 'zstd -d'), b'\x1f\x8b': ('gzip', 'gunzip'), b'BZh': ('bzip2', 'bunzip2'),
          b'\xfd7zXZ\0': ('xz', 'unxz'), b'PK\x03\x04': ('zip', 'unzip'), b'\x04\x22\x4d\x18': ('lz4', 'lz4 -d'),
          b'7z\xbc\xaf\x27\x1c': ('7z', '7z x')}
"""First bytes of a compressed file -> its format, and the command that unpacks it."""
MCAP_END = next(iter(KINDS))
LAST_VERSION = 9
"""Latest version of ``metadata.yaml`` that is known here."""
FIELDS = {'starting_time', 'duration', 'message_count', 'topics_with_message_count'}
"""Fields that ``metadata.yaml`` must have, besides those that name the files."""
CONVERTERS = {'sensor_msgs/msg/PointCloud2': 'the ROS package pointcloud_to_laserscan',
              'sensor_msgs/msg/MultiEchoLaserScan': 'the ROS package laser_proc'}
"""Message type -> the ROS package that converts its messages to laser scans."""


def kind_of(start):
    """Return the format of a bag file from its first bytes `start`, or None if it is no bag file."""
    return _by_start(KINDS, start)


def kind_at(path):
    """Return the format of the bag file at `path` from its first bytes; None if it is no file or no bag file."""
    return kind_of(_start(path)) if path.is_file() else None


def unpacking_advice(path, start):
    """Return how to unpack the file at `path`; None if its first bytes `start` are not those of a compressed file."""
    packed = _by_start(PACKED, start)
    if packed is None:
        return None
    name, command = packed
    return f'{path}: a file compressed with {name}: unpack it, {command} {_quoted(path)}, and name the result' + (
        ', or name its folder where there is a metadata.yaml' if name == 'zstd' else '')


def fault_of(path, words) -> str:
    """Return one line with the reason why the bag at `path` cannot be opened, and the remedy.

    `words` are the reason of the reader, after a colon; shown if the bytes of the bag give no better one.
    """
    try:
        found = _of_folder(path) if path.is_dir() else _of_file(path)
    except OSError as error:
        found = f'cannot be read: {error.strerror}'
    return f'{path}: {found or f"damaged, or of a kind that is not known here{words}"}'


def fault_of_part(file) -> str:
    """Return one line with the reason why one of the files of a bag folder cannot be read, and the remedy."""
    metadata = _read_metadata(file.parent)
    found = metadata and _of_named_file(file, metadata)
    return found or f'{file.name} is damaged'


def other_contents(connections) -> str:
    """Return a text with the topics of a bag without laser scans, and how to convert them to laser scans."""
    kinds = sorted({(connection.topic, connection.msgtype) for connection in connections})
    held = ', '.join(f'{topic} ({kind})' for topic, kind in kinds)
    advice = [f'{CONVERTERS[kind]} makes laser scans of {kind}' for kind in CONVERTERS if kind in dict(kinds).values()]
    return '; '.join([f'there are {held}' if held else 'there is no topic at all', *advice])


class _Metadata(NamedTuple):
    """Content of ``metadata.yaml``: the names of the files, their storage, and their compression or None."""

    names: list
    storage: str
    compression: str | None


def _of_folder(folder):
    """Return the first fault of a bag folder, or None."""
    files = sorted(file.name for file in folder.iterdir() if kind_at(file))
    instead = f'name the file itself: {folder / files[0]}' if files else 'it holds no file of a bag'
    metadata = _read_metadata(folder)
    if metadata is None:
        return f'its metadata.yaml is damaged, or of a version that is not known here; {instead}, or write it again: ' \
               f'ros2 bag reindex {_quoted(folder)}'
    for name in metadata.names:
        file = folder / name
        if not file.is_file():
            return f'metadata.yaml names {name}, which is not there; {instead}'
        if fault := _of_named_file(file, metadata):
            return fault
    return None


def metadata_of(folder) -> dict:
    """Return the fields of ``metadata.yaml`` in a folder, which is whole."""
    import yaml
    fields: dict = yaml.safe_load((folder / 'metadata.yaml').read_text(encoding='utf-8'))['rosbag2_bagfile_information']
    return fields


def names_of(folder) -> list:
    """Return the names of the files of the bag in a `folder`; none if it is no folder, or its metadata is damaged."""
    metadata = _read_metadata(folder) if folder.is_dir() else None
    return metadata.names if metadata else []


def _read_metadata(folder):
    """Return the `_Metadata` in a folder, or None if it is damaged."""
    import yaml
    try:
        fields = metadata_of(folder)
        if fields['version'] > LAST_VERSION or FIELDS - fields.keys():
            return None
        mode = (fields.get('compression_mode') or 'none').lower()
        return _Metadata([Path(name).name for name in fields['relative_file_paths']], fields['storage_identifier'],
                         fields.get('compression_format') if mode == 'file' else None)
    except (yaml.YAMLError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None


def _of_named_file(file, metadata):
    """Return how a bag `file` contradicts the `metadata` of its folder, else the fault of the file, or None."""
    name, compression, start = file.name, metadata.compression, _start(file)
    if packed := _by_start(PACKED, start):
        if compression == packed[0]:
            return None
        says = f'that it is compressed with {compression}' if compression else 'that it is not compressed'
        return f'{name} is compressed with {packed[0]}, metadata.yaml says {says}; unpack it: ' \
               f'{packed[1]} {_quoted(file)}'
    kind = kind_of(start)
    if kind is None:
        return f'{name} is no file of a bag, or its start is damaged'
    if compression:
        return f'metadata.yaml says that {name} is compressed with {compression}, it is a plain {kind} file; ' \
               f'name the file itself: {file}'
    if metadata.storage != kind:
        return f'metadata.yaml says storage {metadata.storage!r}, {name} is an {kind} file; ' \
               f'name the file itself: {file}'
    fault = _of_file(file)
    return f'{name}: {fault}' if fault else None


def _of_file(file):
    kind, name = kind_of(_start(file)), _quoted(file)
    if kind == 'ROS 1 bag' and file.suffix == '.active':
        return f'a recording that was not closed; mend it with ROS 1: rosbag reindex {name}, and let its name end ' \
               'with .bag'
    if kind and file.suffix != ENDINGS[kind]:
        return f'holds {kind} data, and its name does not end with {ENDINGS[kind]}; rename it'
    if kind == 'ROS 1 bag':
        return f'a ROS 1 bag whose index is damaged or missing; mend it with ROS 1: rosbag reindex {name}'
    mended = _quoted(file.with_name(f'{file.stem}_recovered{file.suffix}'))
    if kind == 'mcap':
        closed = _end(file, len(MCAP_END)) == MCAP_END
        what = 'a damaged mcap file' if closed else 'a recording that was not closed, as after a loss of power'
        return f'{what}; mend it: mcap recover {name} -o {mended}'
    if kind == 'sqlite3':
        return f'a damaged sqlite3 file; save what can be read: sqlite3 {name} .recover | sqlite3 {mended}'
    return None


def _quoted(path):
    """Return the absolute path, quoted for a command line."""
    return shlex.quote(str(path.absolute()))


def _by_start(table, start):
    return next((value for magic, value in table.items() if start.startswith(magic)), None)


def _start(file):
    with open(file, 'rb') as content:
        return content.read(16)


def _end(file, size):
    with open(file, 'rb') as content:
        content.seek(-min(size, file.stat().st_size), 2)
        return content.read()
