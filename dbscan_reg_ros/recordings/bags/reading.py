# SPDX-License-Identifier: Apache-2.0
"""Access to the messages of a bag, whole or damaged."""
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from ...core.errors import DbscanRegError, RecordingError
from ...paths import check_file
from .bag_faults import fault_of, fault_of_part, kind_at, metadata_of, names_of


@contextmanager
def open_reader(path):
    """Provide the `BagReader` of the library that can read the bag at `path`, or its sound files.

    Raises a RecordingError when the bag cannot be opened.
    """
    for file in path.iterdir() if path.is_dir() else (path,):
        if not file.is_dir():
            check_file(file, RecordingError)
    library = bag_library(ros1=is_ros1(path))
    with ExitStack() as stack:
        try:
            reader = library.BagReader(path)
        except Exception as error:
            reader, faults = stack.enter_context(sound_parts(library, path))
            if reader is None:
                raise RecordingError(fault_of(path, own(error))) from error
            reader.faults = faults
        else:
            stack.callback(reader.close)
        yield reader


def safely(reader, connections, report, **window):
    """Yield the reader's messages (connection, record time [ns], bytes) except damaged ones; report the damage.

    Behind damage only the further files of the bag are read, if there are several.
    """
    for fault in reader.faults:
        report(fault)
    messages = reader.messages(connections=connections, **window)
    topics = ', '.join(sorted({connection.topic for connection in connections}))
    counted = sum(connection.msgcount for connection in connections)
    number = 0
    while True:
        try:
            message = next(messages)
        except StopIteration:
            if number < counted and not window:
                report(f'{reader.path.name}: {number} of {counted} messages of {topics} can be read, the bag is '
                       'damaged')
            return
        except Exception as error:  # noqa: BLE001 - a damaged bag makes the library raise nearly anything
            report(f'{reader.path.name}: messages from number {number + 1} of {topics} cannot be read, the bag is '
                   f'damaged{own(error)}')
            yield from _after_damage(reader, connections, report, window)
            return
        number += 1
        yield message


def _after_damage(reader, connections, report, window):
    """Yield the messages of the files of a bag after the first damaged one, as `safely`."""
    library, known = bag_library(), {(each.topic, each.msgtype): each for each in connections}
    name, fault = damaged_part(library, reader.path, {topic for topic, _ in known})
    if name is None:
        return
    report(fault)
    with sound_parts(library, reader.path, after=name) as (later, faults):
        for each in faults:
            report(each)
        wanted = [each for each in (later.connections if later else ()) if (each.topic, each.msgtype) in known]
        for connection, time, raw in safely(later, wanted, report, **window) if wanted else ():
            yield known[connection.topic, connection.msgtype], time, raw


def own(error) -> str:
    """Return the text of one of our own errors, after a colon; empty for an error of a library."""
    return f': {error}' if isinstance(error, DbscanRegError) else ''


def is_ros1(path) -> bool:
    """Whether the file at `path` is a ROS 1 bag."""
    return kind_at(path) == 'ROS 1 bag'


def bag_library(ros1=False):
    """Return the module that reads and writes bags: `with_rosbags` if `rosbags` is installed, else `with_rosbag2_py`.

    Only the former supports ROS 1 bags. Raises a ModuleNotFoundError when no library is installed, which names
    `rosbags`: it can be installed on any system.
    """
    if ros1 or find_spec('rosbags') or not find_spec('rosbag2_py'):
        try:
            from . import with_rosbags
        except ModuleNotFoundError as missing:
            if missing.name != 'rosbags':
                raise
            raise ModuleNotFoundError('bags need the package rosbags: pip install rosbags', name='rosbags') from None
        return with_rosbags
    from . import with_rosbag2_py
    return with_rosbag2_py


METADATA = 'metadata.yaml'


@contextmanager
def sound_parts(library, folder, after=None):
    """Provide a reader of those files of a bag that can be opened, and a line about each of the others.

    With `after` only the files behind the one of this name are read. The reader is None if no file can be opened, or
    the bag does not have several.
    """
    names = names_of(folder)
    names, several = names[names.index(after) + 1 if after else 0:], len(names) > 1
    faults, sound = [], []
    for name in names if several else ():
        (faults if (fault := _fault(library, folder, name)) else sound).append(fault or name)
    with ExitStack() as stack:
        yield (stack.enter_context(_opened(library, folder, sound)) if sound else None), faults


def damaged_part(library, folder, topics):
    """Return the name of the first of several files of a bag whose messages on some `topics` cannot be read, or None.

    Returns also a line about this file.
    """
    names = names_of(folder)
    for name in names if len(names) > 1 else ():
        if fault := _fault(library, folder, name, topics):
            return name, fault
    return None, ''


def _fault(library, folder, name, topics=()):
    """Return why a file of a bag cannot be opened, or its messages on the `topics` not be read; empty if they can."""
    if not (folder / name).is_file():
        return f'{folder.name}: {METADATA} names {name}, which is not there: the other files are read'
    try:
        with _opened(library, folder, [name]) as reader:
            for _ in reader.messages([c for c in reader.connections if c.topic in topics]) if topics else ():
                pass
    except Exception:  # noqa: BLE001 - a damaged bag makes the library raise nearly anything
        return f'{folder.name}: {fault_of_part(folder / name)}; the other files are read'
    return ''


@contextmanager
def _opened(library, folder, names):
    """Provide a reader of the files of a bag with these `names`."""
    import yaml
    information = metadata_of(folder)
    files = [each for each in information.get('files') or () if Path(each['path']).name in names]
    with TemporaryDirectory() as place:
        copy = Path(place, folder.resolve().name)
        copy.mkdir()
        for name in names:
            (copy / name).symlink_to((folder / name).resolve())
        (copy / METADATA).write_text(yaml.safe_dump({'rosbag2_bagfile_information': {
            **information, 'relative_file_paths': names, 'files': files}}), encoding='utf-8')
        reader = library.BagReader(copy)
        try:
            yield reader
        finally:
            reader.close()
