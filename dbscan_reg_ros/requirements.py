# SPDX-License-Identifier: Apache-2.0
"""Python packages that a command needs, and the command that installs the missing ones."""
import shlex
import shutil
import sys
import sysconfig
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from .build_check import check_build
from .command_lines import PACKAGE, python_line
from .core.errors import DbscanRegError

ROS = 'rclpy'
"""Module that can be imported if ROS 2 is installed."""
ROS_SETUP = Path('/opt/ros/jazzy/setup.bash')
ROS_WHEELS = 'ros-rclpy[fastrtps]==7.1.6', 'ros-common-interfaces==5.3.6'


class Source(NamedTuple):
    """Names of a package in Ubuntu ('' if Ubuntu does not have it) and on PyPI."""

    ubuntu: str
    pypi: str


SOURCES = {
    'distributed': Source('', 'distributed'),
    'kiss_icp': Source('', 'kiss-icp'),
    'matplotlib': Source('python3-matplotlib', 'matplotlib'),
    'numpy': Source('python3-numpy', 'numpy'),
    'optuna': Source('', 'optuna'),
    'rosbags': Source('', 'rosbags'),
    'scipy': Source('python3-scipy', 'scipy'),
    'sklearn': Source('python3-sklearn', 'scikit-learn'),
    'small_gicp': Source('', 'small_gicp'),
    'tqdm': Source('python3-tqdm', 'tqdm'),
    'yaml': Source('python3-yaml', 'PyYAML'),
}
"""Module -> names of the package that contains it."""

EXTRA = 'matplotlib', 'rosbags', 'tqdm'
"""Modules that ``pip install '.[commands]'`` brings."""
WITH_EXTRA = " (or in the folder of the source, with all that the commands need: pip install '.[commands]')"
_CORE = 'numpy', 'scipy', 'yaml'
NEEDS = {
    'scan_matcher': (*_CORE, ROS),
    'scan_matcher_lifecycle': (*_CORE, ROS),
    'replay': (*_CORE, 'matplotlib', 'tqdm'),
    'register': _CORE,
    'play': (*_CORE, 'tqdm', ROS),
    'demo': (*_CORE, 'matplotlib', 'tqdm', ROS),
    'calibrate': (*_CORE, 'tqdm'),
    'compare': (*_CORE, 'matplotlib', 'tqdm'),
    'tune': (*_CORE, 'tqdm'),
    'simulate': (*_CORE, 'matplotlib'),
    'watch': (*_CORE, 'matplotlib', ROS),
    'convert': (*_CORE, 'tqdm'),
    'bench': (*_CORE, 'matplotlib', 'sklearn', 'tqdm'),
}
"""Command -> modules that the command requires."""


class MissingPackages(DbscanRegError):
    """Packages that a command needs are not installed."""


def is_there(module) -> bool:
    """Return whether the module is installed, without importing it."""
    return find_spec(module) is not None


def check_packages(command, also=()):
    """Raise MissingPackages if modules are not installed that `command`, or (in `also`) its arguments need.

    Then raise BuildError if the compiled modules do not serve.
    """
    missing = [module for module in dict.fromkeys((*NEEDS.get(command, ()), *also)) if not is_there(module)]
    if missing:
        raise MissingPackages(missing_line(missing))
    if NEEDS.get(command):
        check_build()


def missing_line(modules) -> str:
    """Return one line with the names of the missing `modules` and a command that installs them on this system."""
    names = [SOURCES[module].pypi if module in SOURCES else f'ROS 2 ({module})' if _is_ros(module) else module
             for module in modules]
    remedies = ' && '.join(_remedies(modules))
    return f'needs {" and ".join(names)}, not installed here' + (f': {remedies}' if remedies else '')


def _is_ros(module):
    return module == ROS or module.endswith(('_msgs', '_srvs', '_interfaces'))


def _remedies(modules):
    """Yield the commands that, run one after the other, make the `modules` importable."""
    system = sys.prefix == '/usr' and shutil.which('apt') is not None
    ubuntu, wheels = _packages(modules, system)
    if ubuntu:
        yield shlex.join(['sudo', 'apt', 'install', *ubuntu])
    if any(map(_is_ros, modules)):
        if ROS_SETUP.exists():
            yield f'source {ROS_SETUP}'
        elif system:
            yield 'install ROS 2 Jazzy (https://docs.ros.org/en/jazzy/Installation.html)'
        else:
            wheels += ROS_WHEELS
    if wheels:
        yield _pip(wheels) + WITH_EXTRA * any(module in EXTRA for module in modules)


def _packages(modules, system):
    """Return the packages of the `modules` from Ubuntu (only for the Python of the `system`) and those from PyPI."""
    known = [SOURCES[module] for module in modules if module in SOURCES]
    ubuntu = [source for source in known if system and source.ubuntu]
    return [source.ubuntu for source in ubuntu], [source.pypi for source in known if source not in ubuntu]


def _pip(wheels):
    """Return the command that installs `wheels` with pip; for the Python of the system, in a virtual environment."""
    if sys.prefix != sys.base_prefix or not Path(sysconfig.get_path('stdlib'), 'EXTERNALLY-MANAGED').exists():
        return python_line('-m', 'pip', 'install', *wheels)
    folder = Path.home() / '.venvs' / PACKAGE
    python = shlex.quote(str(folder / 'bin' / 'python'))
    return (f'{python_line("-m", "venv", "--system-site-packages", folder)} && {python} -m pip install '
            f'{shlex.join(wheels)}')
