# SPDX-License-Identifier: Apache-2.0
"""What colcon, bloom and pip install, and what an installed executable answers."""
import importlib.util
import os
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest
from rooms import room_log

from dbscan_reg_ros.command_lines import COMMANDS, version

PACKAGE = 'dbscan_reg_ros'
RUN = '''
import numpy as np, dbscan_reg_ros as package
angles = np.linspace(-3.0, 3.0, 300)
scan = package.Scan.from_ranges(2.0 + np.abs(np.sin(angles)), angles)
print(package.__file__, package.register(scan, scan).status.name)
'''


@pytest.fixture(scope='module')
def succeed(tools):
    """``succeed(words, folder, **environment)``: what a command prints; a build finds the Cython of scripts/setup."""
    def succeed(words, folder, **environment):
        variables = os.environ | environment
        variables['PYTHONPATH'] = os.pathsep.join(filter(None, [variables.get('PYTHONPATH'), str(tools)]))
        result = subprocess.run(words, cwd=folder, env=variables, capture_output=True, text=True, timeout=900,
                                check=False)
        assert result.returncode == 0, result.stdout + result.stderr
        return result.stdout
    return succeed


@pytest.fixture(scope='module')
def colcon_build(copied, succeed):
    """``colcon_build(workspace, *options)``: the prefix that ``colcon build`` installs the package to."""
    colcon = shutil.which('colcon', path=f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}')
    if colcon is None:
        pytest.skip('needs colcon')

    def build(workspace, *options):
        copied(workspace / 'src' / PACKAGE, workspace / 'build' / PACKAGE / 'build')
        succeed([colcon, '--log-base', 'log', 'build', '--packages-select', PACKAGE, *options], workspace)
        return workspace / 'install' / PACKAGE
    return build


@pytest.fixture(scope='module')
def installed(colcon_build, tmp_path_factory):
    """The prefix that ``colcon build`` has installed the package to; its source is gone."""
    workspace = tmp_path_factory.mktemp('workspace')
    prefix = colcon_build(workspace)
    shutil.rmtree(workspace / 'src')
    return prefix


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
def test_colcon_links_every_command_where_ros2_run_looks(colcon_build, succeed, tmp_path):
    prefix = colcon_build(tmp_path / 'linked', '--symlink-install')
    assert executables(prefix) == (set(), set(COMMANDS))
    assert (prefix / 'share' / PACKAGE / 'package.xml').is_symlink()
    said = succeed(['bash', '-c', f'source {prefix.parent}/setup.bash && {prefix}/lib/{PACKAGE}/replay --version'],
                   tmp_path)
    assert said == f'{PACKAGE} {version()}\n'


@pytest.mark.long
def test_bloom_installs_every_command_where_ros2_run_looks(copied, succeed, tmp_path):
    """As its debian/rules do: it hands --install-scripts on only where setup.cfg does not say where."""
    source = copied(tmp_path / 'bloom', tmp_path / 'bloom' / 'build')
    succeed([sys.executable, 'setup.py', 'install', '--root', tmp_path, '--prefix', '/opt/ros/jazzy', '--install-lib',
             '$base/lib/python3.12/site-packages'], source)
    assert executables(tmp_path / 'opt/ros/jazzy') == (set(), set(COMMANDS))


@pytest.fixture
def pip_install(succeed, tmp_path):
    """``pip_install(source, **environment)``: the folder to which pip installs the package, which registers there."""
    def pip_install(source, **environment):
        target = tmp_path / 'target'
        succeed([sys.executable, '-m', 'pip', 'install', '-q', '--no-index', '--no-deps', '--no-build-isolation',
                 '--target', target, '.'], source, **environment)
        file, status = succeed([sys.executable, '-c', RUN], target, PYTHONPATH=str(target)).split()
        assert file.startswith(str(target)) and status != 'FAILED'
        assert [path.name for path in (target / 'bin').iterdir()] == ['dbscan-reg-ros']
        return target
    if not (importlib.util.find_spec('wheel') or importlib.util.find_spec('setuptools.command.bdist_wheel')):
        pytest.skip('needs setuptools 70.1, or the package wheel')
    return pip_install


def test_pip_installs_one_command_and_a_package_that_registers(pip_install, copied, tmp_path):
    target = pip_install(copied(tmp_path / PACKAGE, tmp_path / PACKAGE / 'build'))
    assert not list(target.rglob('*.c')) and (target / PACKAGE / 'py.typed').exists()


@pytest.mark.long
def test_a_source_distribution_is_compiled_without_cython(pip_install, succeed, copied, root, tmp_path):
    succeed([sys.executable, 'setup.py', '-q', 'sdist', '-d', tmp_path], copied(tmp_path / PACKAGE))
    archive, = tmp_path.glob('*.tar.gz')
    with tarfile.open(archive) as file:
        file.extractall(tmp_path / 'unpacked')
    folder, = (tmp_path / 'unpacked').iterdir()
    pip_install(folder, WITHOUT_PACKAGES='Cython', PYTHONPATH=str(root / 'test' / 'without'), CFLAGS='-O0')


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
