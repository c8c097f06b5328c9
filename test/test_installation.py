"""What the manifest, the installation and an installed executable have to agree on."""
import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from dbscan_reg_ros.commands import COMMANDS

PACKAGE = 'dbscan_reg_ros'
ROSDEP_KEYS = {'matplotlib': 'python3-matplotlib', 'numpy': 'python3-numpy', 'scipy': 'python3-scipy',
               'sklearn': 'python3-sklearn', 'tf2_ros': 'tf2_ros_py', 'tqdm': 'python3-tqdm', 'yaml': 'python3-yaml'}
NO_ROSDEP_KEY = {'distributed', 'lz4', 'optuna', 'rosbags'}
"""Got by pip; lz4 comes with rosbags."""
ONLY_COMPARED_WITH = {'kiss_icp', 'small_gicp'}


@pytest.fixture(scope='module')
def manifest(root):
    return ElementTree.parse(root / 'package.xml').getroot()


@pytest.fixture(scope='module')
def installed(root, tmp_path_factory):
    """The prefix that ``colcon build`` has installed the package to."""
    colcon = shutil.which('colcon', path=f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}')
    if colcon is None:
        pytest.skip('needs colcon')
    scratch = tmp_path_factory.mktemp('workspace')
    source = scratch / 'src' / PACKAGE
    shutil.copytree(root, source, ignore=shutil.ignore_patterns('.*', '__pycache__', 'build', 'results', '*.egg-info'))
    result = subprocess.run([colcon, '--log-base', 'log', 'build', '--packages-select', PACKAGE], cwd=scratch,
                            capture_output=True, text=True, timeout=300, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    shutil.rmtree(source)
    return scratch / 'install' / PACKAGE


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


def requirements_of(package):
    """Top-level modules of others that a package's files import."""
    names = set()
    for path in package.rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                names.add(node.module.partition('.')[0])
    return names - sys.stdlib_module_names - {PACKAGE}


def test_manifest_and_setup_agree(root, manifest):
    setup = subprocess.run([sys.executable, 'setup.py', '--name', '--version', '--license'], cwd=root, check=True,
                           capture_output=True, text=True).stdout.split()
    assert setup == [manifest.findtext('name'), manifest.findtext('version'), manifest.findtext('license')]
    assert manifest.get('format') == '3' and manifest.findtext('export/build_type') == 'ament_python'


def test_the_manifest_names_every_package_that_is_imported(root, manifest):
    named = {element.text for element in manifest if element.tag in ('depend', 'exec_depend')}
    imported = requirements_of(root / PACKAGE) | requirements_of(root / 'launch')
    needed = {ROSDEP_KEYS.get(name, name) for name in imported - NO_ROSDEP_KEY - ONLY_COMPARED_WITH}
    assert needed <= named


def test_every_command_is_installed_as_an_executable(installed):
    assert {path.name for path in (installed / 'lib' / PACKAGE).iterdir()} == set(COMMANDS)


def test_the_package_is_known_to_the_ament_index(installed):
    assert (installed / 'share/ament_index/resource_index/packages' / PACKAGE).is_file()
    assert (installed / 'share' / PACKAGE / 'package.xml').is_file()


@pytest.mark.parametrize('folder', ['config', 'launch'])
def test_ready_made_files_are_installed(root, installed, folder):
    source = {path.name for path in (root / folder).iterdir() if path.is_file()}
    assert source and {path.name for path in (installed / 'share' / PACKAGE / folder).iterdir()} == source


@pytest.mark.parametrize('command', COMMANDS)
def test_installed_executables_run(workspace, tmp_path, command):
    result = subprocess.run([workspace / 'lib' / PACKAGE / command, '--help'], cwd=tmp_path, capture_output=True,
                            text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr
    assert result.stdout.startswith('usage: ')


def test_the_installed_node_answers_the_installed_player(workspace, start, tmp_path):
    node = start(workspace / 'lib' / PACKAGE / 'scan_matcher', '--ros-args', '-p', 'mounting:=none')
    result = subprocess.run([workspace / 'lib' / PACKAGE / 'play', '--lockstep', room_log(tmp_path / 'room.log', 20)],
                            cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False)
    assert result.returncode == 0, result.stderr + node.output()
    assert result.stdout == 'scans 20 answered 20 skipped 0\n'
    assert node.stop() == 0, node.output()


def room_log(path, count):
    """A CARMEN log of a sensor that stands in a room of 7 m by 5 m."""
    x, y = (np.array(f(np.radians(np.arange(-90, 90)))) for f in (np.cos, np.sin))
    with np.errstate(divide='ignore'):
        ranges = np.minimum(np.where(x > 0, 4.0, 3.0) / np.abs(x), np.where(y > 0, 2.0, 3.0) / np.abs(y))
    words = ' '.join(f'{r:.3f}' for r in ranges)
    path.write_text(''.join(f'FLASER 180 {words} 0 0 0 0 0 0 {10 + 0.1 * k:.1f} host {0.1 * k:.1f}\n' for k in range(count)))
    return path
