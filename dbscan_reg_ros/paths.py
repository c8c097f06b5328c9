# SPDX-License-Identifier: Apache-2.0
"""Checks of paths that a user names, for reading and for writing, and the folder of ready-made parameter files."""
import os
import stat
import tempfile
from pathlib import Path

NO_SENSORS = 'ekf', 'scan_matcher'
"""Files in `config_folder` that are not parameter sets of a sensor: one for another package, and the defaults."""

_OTHERS = ((stat.S_ISDIR, 'a folder'), (stat.S_ISFIFO, 'a pipe'), (stat.S_ISSOCK, 'a socket'),
           (stat.S_ISCHR, 'a device'), (stat.S_ISBLK, 'a device'))


def check_file(path, error_type):
    """Raise `error_type` if `path` exists and is no file: reading a pipe or a device may block, or never end.

    A missing path is no error in this check, because opening the path raises one.
    """
    try:
        mode = os.stat(path).st_mode
    except (OSError, ValueError):
        return
    for is_other, name in _OTHERS:
        if is_other(mode):
            advice = '' if name == 'a folder' else '; save its output to a file and name that file'
            raise error_type(f'{path}: expected a file, and it is {name}{advice}')


def check_writable(path, error_type):
    """Raise `error_type` if no file or folder can be created at `path`, or in `path` if that is a folder.

    Missing parent folders are no error. The check leaves no file behind.
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


def expanded(parameter, name, error_type) -> Path:
    """Return the path of a `parameter`, a leading ~ as the home directory; raise `error_type` if there is none."""
    try:
        return Path(name).expanduser()
    except RuntimeError:
        raise error_type(f'{parameter} = {name!r}: no such user') from None


def config_folder() -> Path:
    """Return the folder of ready-made parameter files: that of the source tree if it exists, else the installed one."""
    package = Path(__file__).absolute().parent
    source = package.parent / 'config'
    return source if source.is_dir() else package.parents[3] / 'share' / package.name / 'config'


def ready_made() -> list:
    """Return the names of the parameter sets in `config_folder`."""
    return sorted(path.stem for path in config_folder().glob('*.yaml') if path.stem not in NO_SENSORS)


def parameter_file(name) -> Path:
    """Return the path of a parameter file: `name`, or the file of the parameter set with this name, as ``lds``."""
    path = Path(name)
    return config_folder() / f'{name}.yaml' if not path.exists() and name in ready_made() else path
