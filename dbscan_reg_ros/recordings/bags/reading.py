# SPDX-License-Identifier: Apache-2.0
"""Access to the messages of a bag, whole or damaged."""
from contextlib import contextmanager

from ...core.errors import DbscanRegError, RecordingError
from ...paths import check_file
from .bag_faults import fault_of
from .bag_library import bag_library, is_ros1


@contextmanager
def open_reader(path):
    """Provide the `BagReader` of the library that can read the bag at `path`.

    Raises
    ------
    RecordingError
        When the bag cannot be opened.
    """
    for file in path.iterdir() if path.is_dir() else (path,):
        if not file.is_dir():
            check_file(file, RecordingError)
    library = bag_library(ros1=is_ros1(path))
    try:
        reader = library.BagReader(path)
    except Exception as error:
        raise RecordingError(fault_of(path, own(error))) from error
    try:
        yield reader
    finally:
        reader.close()


def safely(reader, connections, report, **window):
    """Yield the reader's messages (connection, record time [ns], bytes) until the bag is damaged; report the damage."""
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
            return
        number += 1
        yield message


def own(error) -> str:
    """Return the text of one of our own errors, after a colon; empty for an error of a library."""
    return f': {error}' if isinstance(error, DbscanRegError) else ''
