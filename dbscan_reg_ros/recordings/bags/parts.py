# SPDX-License-Identifier: Apache-2.0
"""ROS 2 bags of several files, of which some are missing or damaged."""
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from .bag_faults import fault_of_part, metadata_of, names_of

METADATA = 'metadata.yaml'


@contextmanager
def sound_parts(library, folder, after=None):
    """Provide a reader of those files of a bag that can be opened, and a line about each of the others.

    Parameters
    ----------
    library : module
        Library that reads the bag.
    folder : Path
    after : str, optional
        Name of a file: only those after it are read.

    Yields
    ------
    BagReader or None
        None if no file can be opened, or the bag does not have several.
    list of str
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
