# SPDX-License-Identifier: Apache-2.0
"""Result folders: one for each run, named after date and time, and the link ``latest`` to the newest one."""
import os
import time
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
