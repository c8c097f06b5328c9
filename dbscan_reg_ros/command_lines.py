# SPDX-License-Identifier: Apache-2.0
"""The command lines that users are shown: they run as they are printed, in a shell and from any folder."""
import os
import shlex
import shutil
import site
import sys
from pathlib import Path

PACKAGE = 'dbscan_reg_ros'
PROGRAM = 'dbscan-reg-ros'
"""What pip installs."""
COMMANDS = {
    'scan_matcher': ('node.scan_matcher', 'laser odometry as a ROS 2 node'),
    'scan_matcher_lifecycle': ('node.scan_matcher_lifecycle', 'the same as a managed node'),
    'replay': ('commands.replay', 'odometry of recordings, offline, with a report of each'),
    'register': ('commands.register', 'one scan onto another, in numbers and in the figures of the paper'),
    'play': ('commands.play', 'publish a recording to a running node'),
    'demo': ('commands.demo', 'the node on a simulated building or a recording, with its error'),
    'compare': ('commands.compare', 'two parameter sets or methods on the same recordings: is B worse?'),
    'tune': ('commands.tune', 'search the parameters that suit recordings'),
    'simulate': ('commands.simulate', 'a recording of any lidar in a simulated building, with exact truth'),
    'dump': ('commands.dump', 'the parameters of a running node as a file'),
    'convert': ('commands.convert', 'CARMEN logs and ROS 1 and ROS 2 bags into one another'),
}
"""Name -> module in this package, and what it does."""
ROOT = Path(__file__).absolute().parent.parent
"""The folder that Python finds the package in."""


def command_line(command, *words) -> str:
    """The line that runs the `command` of the package with the `words`, the way that this process was started.

    Relative paths among the `words` stay relative.
    """
    return shlex.join([*_program(Path(sys.argv[0])), command, *map(os.fspath, words)])


def python_line(*words) -> str:
    """The line that runs this interpreter with the `words`."""
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
