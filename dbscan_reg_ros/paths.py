# SPDX-License-Identifier: Apache-2.0
"""What lies at a path that a user names, what can be written there, and the folder of ready-made parameter files."""
import os
import stat
import tempfile
from pathlib import Path

NO_SENSORS = 'ekf', 'scan_matcher'
"""Files in `config_folder` that hold no parameter set to choose: for another package, and the defaults."""

_OTHERS = ((stat.S_ISDIR, 'a folder'), (stat.S_ISFIFO, 'a pipe'), (stat.S_ISSOCK, 'a socket'),
           (stat.S_ISCHR, 'a device'), (stat.S_ISBLK, 'a device'))


def check_file(path, error_type):
    """Raise `error_type` if `path` exists and is no file: reading a pipe or a device may block, or never end.

    A missing path is no error here: opening it raises one.
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return
    for is_other, name in _OTHERS:
        if is_other(mode):
            advice = '' if name == 'a folder' else '; save what it gives to a file and name that'
            raise error_type(f'{path}: expected a file, and it is {name}{advice}')


def check_writable(path, error_type):
    """Raise `error_type` where no file or folder can be made at `path`, nor in the folder that it is.

    Folders that are missing on the way there can be made later; nothing is left behind.
    """
    nearest = Path(path).absolute()
    while not os.path.lexists(nearest):
        nearest = nearest.parent
    if nearest.is_file() and nearest == Path(path).absolute():
        nearest = nearest.parent
    try:
        with tempfile.TemporaryFile(dir=nearest):
            pass
    except OSError as error:
        raise error_type(f'{path}: cannot be written, {nearest}: {error.strerror}; choose another place') from error


def config_folder() -> Path:
    """Return the folder of ready-made parameter files, of the source or installed."""
    package = Path(__file__).absolute().parent
    source = package.parent / 'config'
    return source if source.is_dir() else package.parents[3] / 'share' / package.name / 'config'


def ready_made() -> list:
    """Names of the parameter sets in `config_folder`."""
    return sorted(path.stem for path in config_folder().glob('*.yaml') if path.stem not in NO_SENSORS)
