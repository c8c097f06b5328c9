# SPDX-License-Identifier: Apache-2.0
"""Command lines that are shown to users, as printed they run in a shell and from any folder; version of the package."""
import argparse
import os
import shlex
import shutil
import site
import sys
from collections.abc import Sequence
from pathlib import Path

PACKAGE = 'dbscan_reg_ros'
PROGRAM = 'dbscan-reg-ros'
"""Name of the script that pip installs."""
SCRIPT = 'DBSCAN_REG_SCRIPT'
"""Environment variable with the words by which a user has started a script that runs the command of its name."""
COMMANDS = {
    'scan_matcher': ('node.scan_matcher', 'laser odometry as a ROS 2 node'),
    'scan_matcher_lifecycle': ('node.scan_matcher_lifecycle', 'laser odometry as a ROS 2 lifecycle node'),
    'replay': ('commands.replay', 'run the odometry over recordings, offline, with a report of each'),
    'register': ('commands.register', 'register one scan to another; print and draw every step'),
    'play': ('commands.play', 'publish a recording to a running node'),
    'watch': ('commands.watch', 'show a running node live in a browser'),
    'demo': ('commands.demo', 'run the node on a simulated building or a recording and print its error'),
    'calibrate': ('commands.calibrate', 'estimate mountings and time offsets of several lidars of a recording'),
    'compare': ('commands.compare', 'compare two parameter sets or methods on the same recordings'),
    'tune': ('commands.tune', 'search parameter values on recordings'),
    'simulate': ('commands.simulate', 'simulate a recording of any lidar, with exact truth'),
    'convert': ('commands.convert', 'convert between CARMEN logs, ROS 1 bags and ROS 2 bags'),
}
"""Command -> its module in this package, and its purpose."""
ROOT = Path(__file__).absolute().parent.parent
"""Folder in which Python finds the package."""
MANIFEST = ROOT / 'package.xml'
"""Manifest with the version; it exists only if the package runs from its source tree."""


def command_line(command, *words) -> str:
    """Return the command line that runs `command` with `words` in the same manner as this process was started.

    Relative paths among the `words` stay relative.
    """
    return shlex.join([*_program(Path(sys.argv[0])), command, *map(os.fspath, words)])


def started_as(*command) -> str:
    """Return the words by which a user has started a `command`, for its usage line: without folders and variables."""
    script = os.environ.get(SCRIPT, '')
    if command == (Path(script).name,):
        return script
    started = Path(sys.argv[0])
    if started.parent.name == PACKAGE and started.name in COMMANDS:
        return ' '.join(('ros2', 'run', PACKAGE, *command))
    if started.name == PROGRAM:
        return ' '.join((PROGRAM, *command))
    return ' '.join((Path(sys.executable).name, '-m', PACKAGE, *command))


def python_line(*words) -> str:
    """Return the command line that runs this interpreter with `words`."""
    return shlex.join([sys.executable, *map(os.fspath, words)])


def _program(started):
    if started.parent.name == PACKAGE and started.name in COMMANDS:
        return 'ros2', 'run', PACKAGE
    if started.name == PROGRAM:
        found = shutil.which(PROGRAM)
        return PROGRAM if found and os.path.samefile(found, started) else os.fspath(started.absolute()),
    python = sys.executable, '-m', PACKAGE
    if ROOT in {Path(folder) for folder in (*site.getsitepackages(), site.getusersitepackages())}:
        return python
    given = [folder for folder in os.environ.get('PYTHONPATH', '').split(os.pathsep) if os.path.isabs(folder)]
    found = dict.fromkeys([os.fspath(ROOT), *given])
    return 'env', f'PYTHONPATH={os.pathsep.join(found)}', *python


def version() -> str:
    """Return the version from the manifest in the source tree, or without one that of the installed package."""
    if MANIFEST.exists():
        from xml.etree import ElementTree
        return str(ElementTree.parse(MANIFEST).getroot().findtext('version'))
    from importlib.metadata import version as installed
    return installed(PACKAGE)


class _Version(argparse.Action):
    """Argparse action that looks up the version only if the option is given."""

    def __call__(self, parser, namespace, values, option_string=None):
        print(f'{PACKAGE} {version()}')
        parser.exit()


def add_version(parser):
    """Add the option ``--version`` to a parser."""
    parser.add_argument('--version', action=_Version, nargs=0, help='show version, and exit')


def split_arguments(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return the arguments of the command, and the ROS arguments from ``--ros-args`` to ``--`` inclusive."""
    own: list[str] = []
    ros: list[str] = []
    inside = False
    for word in argv:
        inside = inside or word == '--ros-args'
        (ros if inside else own).append(word)
        inside = inside and word != '--'
    return own, ros
