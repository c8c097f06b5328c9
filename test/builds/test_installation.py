# SPDX-License-Identifier: Apache-2.0
"""What colcon and bloom install, and what an installed executable answers."""
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from rooms import room_log

from dbscan_reg_ros.command_lines import COMMANDS
from dbscan_reg_ros.version import version

PACKAGE = 'dbscan_reg_ros'
TOOLS = Path(__file__).absolute().parents[2] / 'build' / 'tools'


@pytest.fixture(scope='module')
def source(root, tmp_path_factory):
    """``source(name)``: a new copy of what belongs to the package, in the workspace `name`."""
    def copy(name):
        folder = tmp_path_factory.mktemp(name) / 'src' / PACKAGE
        shutil.copytree(root, folder, ignore=shutil.ignore_patterns('.*', '__pycache__', 'build', 'results',
                                                                    '*.egg-info', '*.so'))
        return folder
    return copy


@pytest.fixture(scope='module')
def colcon_build():
    """``colcon_build(source, *options, **environment)``: the prefix that ``colcon build`` installs the package to."""
    colcon = shutil.which('colcon', path=f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}')
    if colcon is None:
        pytest.skip('needs colcon')

    def build(source, *options, **environment):
        scratch = source.parent.parent
        words = [colcon, '--log-base', 'log', 'build', '--packages-select', PACKAGE, *options]
        succeed(words, scratch, environment)
        return scratch / 'install' / PACKAGE
    return build


def succeed(words, folder, environment=None):
    """What a command prints; a build finds the Cython that scripts/setup installs."""
    variables = os.environ | (environment or {})
    variables['PYTHONPATH'] = os.pathsep.join(filter(None, [variables.get('PYTHONPATH'), str(TOOLS)]))
    result = subprocess.run(words, cwd=folder, env=variables, capture_output=True, text=True, timeout=900, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


@pytest.fixture(scope='module')
def installed(source, colcon_build):
    """The prefix that ``colcon build`` has installed the package to; its source is gone."""
    folder = source('workspace')
    prefix = colcon_build(folder)
    shutil.rmtree(folder)
    return prefix


def says_version(text):
    """Whether a command printed the version."""
    return text == f'{PACKAGE} {version()}\n'


def executables(prefix):
    """The names in ``bin`` and in ``lib/dbscan_reg_ros``."""
    return tuple({path.name for path in (prefix / folder).iterdir()} if (prefix / folder).exists() else set()
                 for folder in ('bin', f'lib/{PACKAGE}'))


@pytest.fixture
def workspace(installed, ros_environment, monkeypatch):
    """The environment after ``source install/setup.bash``: the installed package, not the source."""
    probe = subprocess.run(['bash', '-c', f'source {installed.parent}/setup.bash && env -0'], env=without_package(),
                           capture_output=True, check=True).stdout.decode()
    variables = dict(line.split('=', 1) for line in probe.split('\0') if line)
    for name in ('AMENT_PREFIX_PATH', 'PYTHONPATH'):
        assert str(installed) in variables[name]
        monkeypatch.setenv(name, variables[name])
    return installed


def without_package():
    environment = dict(os.environ)
    environment.pop('PYTHONPATH', None)
    return environment


def test_colcon_installs_every_command_where_ros2_run_looks(installed):
    assert executables(installed) == (set(), set(COMMANDS))


@pytest.mark.long
def test_colcon_links_every_command_where_ros2_run_looks(source, colcon_build, tmp_path):
    folder = source('linked')
    prefix = colcon_build(folder, '--symlink-install')
    assert executables(prefix) == (set(), set(COMMANDS))
    assert (prefix / 'share' / PACKAGE / 'package.xml').is_symlink()
    said = succeed(['bash', '-c', f'source {prefix.parent}/setup.bash && {prefix}/lib/{PACKAGE}/replay --version'],
                   tmp_path)
    assert says_version(said)


@pytest.mark.long
def test_bloom_installs_every_command_where_ros2_run_looks(source, tmp_path):
    """As its debian/rules do: it hands --install-scripts on only where setup.cfg does not say where."""
    succeed([sys.executable, 'setup.py', 'install', '--root', tmp_path, '--prefix', '/opt/ros/jazzy', '--install-lib',
             '$base/lib/python3.12/site-packages'], source('bloom'))
    assert executables(tmp_path / 'opt/ros/jazzy') == (set(), set(COMMANDS))


def test_the_package_is_known_to_the_ament_index(installed):
    assert (installed / 'share/ament_index/resource_index/packages' / PACKAGE).is_file()
    assert (installed / 'share' / PACKAGE / 'package.xml').is_file()


@pytest.mark.parametrize('folder', ['config', 'launch'])
def test_ready_made_files_are_installed(root, installed, folder):
    source = {path.name for path in (root / folder).iterdir() if path.is_file()}
    assert source and {path.name for path in (installed / 'share' / PACKAGE / folder).iterdir()} == source


@pytest.mark.parametrize('command', ['replay', 'scan_matcher'])
def test_installed_executables_run(workspace, tmp_path, command):
    result = subprocess.run([workspace / 'lib' / PACKAGE / command, '--help'], cwd=tmp_path, capture_output=True,
                            text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith(f'usage: ros2 run {PACKAGE} {command} ')


def test_the_installed_node_answers_the_installed_player(workspace, start, tmp_path):
    node = start(workspace / 'lib' / PACKAGE / 'scan_matcher', '--ros-args', '-p', 'mounting:=none')
    result = subprocess.run([workspace / 'lib' / PACKAGE / 'play', '--lockstep', room_log(tmp_path / 'room.log', 20)],
                            cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr + node.output()
    assert result.stdout == 'scans 20 answered 20 skipped 0\n'
    assert node.stop() == 0, node.output()
