# SPDX-License-Identifier: Apache-2.0
"""Access to the messages of a bag, whole or damaged."""
from contextlib import ExitStack, contextmanager

from ...core.errors import DbscanRegError, RecordingError
from ...paths import check_file
from .bag_faults import fault_of
from .bag_library import bag_library, is_ros1
from .parts import damaged_part, sound_parts


@contextmanager
def open_reader(path):
    """Provide the `BagReader` of the library that can read the bag at `path`, or its sound files.

    Raises
    ------
    RecordingError
        When the bag cannot be opened.
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
