# SPDX-License-Identifier: Apache-2.0
"""Result folders, named after date and time, the link ``latest`` to the newest one, and results not written."""
import os
import time
import traceback
from contextlib import contextmanager
from pathlib import Path

from ..command_lines import command_line


def new_folder(parent) -> Path:
    """Create a new folder in `parent`, named after date and time, that no other run uses; return its path."""
    parent = Path(parent)
    parent.mkdir(parents=True, exist_ok=True)
    name, number = time.strftime('%Y-%m-%d_%H-%M-%S'), 1
    while True:
        folder = parent / (name if number == 1 else f'{name}_{number}')
        try:
            folder.mkdir()
        except FileExistsError:
            number += 1
        else:
            return folder


def point_latest(folder):
    """Let the link ``latest`` beside `folder` point to `folder`."""
    link = folder.with_name(f'.latest-{folder.name}')
    os.symlink(folder.name, link)
    os.replace(link, folder.with_name('latest'))


def register_command(folder, recording, lidars) -> str:
    """Return the command line that registers two scans of the recording again if their numbers are appended.

    With several `lidars` (`Lidars`) it numbers the scans of all of them, as the replay does.
    """
    parameters, path = (folder / 'parameters.yaml').absolute(), recording.path.absolute()
    topics = lidars.words() or ['--topic', recording.topic]
    return command_line('register', '--params-file', parameters, *topics, path)


class Faults:
    """Collects the results that could not be written, with the reasons: ``explain(error)`` returns one in one line.

    With `verbose` the traceback of every fault is printed.
    """

    def __init__(self, explain, verbose=False):
        self._explain, self._verbose = explain, verbose
        self._reasons = {}

    @property
    def lines(self) -> list:
        """One line for each part of the results that could not be written, with the first reason."""
        return [f'{part} not written: {reason}' for part, reason in self._reasons.items()]

    @contextmanager
    def noted(self, part):
        """Record an error in the ``with`` block as a fault of `part`, and continue after the block."""
        try:
            yield
        except Exception as error:  # noqa: BLE001 - any fault: the other parts are still written
            self._note(part, error)

    def attempt(self, part, function, *args):
        """Return the result of `function(*args)`; None if it fails, which is recorded, or if `part` failed before."""
        if part in self._reasons:
            return None
        try:
            return function(*args)
        except Exception as error:  # noqa: BLE001 - any fault: the other parts are still written
            self._note(part, error)

    def _note(self, part, error):
        if self._verbose:
            traceback.print_exception(error)
        self._reasons.setdefault(part, self._explain(error))
