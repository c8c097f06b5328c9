# SPDX-License-Identifier: Apache-2.0
"""What a command needs that is not installed: all of it in one line, with a command that installs it."""
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from rooms import room_log

from dbscan_reg_ros import requirements
from dbscan_reg_ros.command_lines import COMMANDS
from dbscan_reg_ros.requirements import EXTRA, NEEDS, ROS, ROS_WHEELS, SOURCES, WITH_EXTRA, missing_line

WORDS = {
    'scan_matcher': [], 'scan_matcher_lifecycle': [], 'replay': ['a.log'], 'play': ['a.log'],
    'register': ['a.log', '0', '1', '--no-figures'],
    'demo': [], 'compare': ['defaults', 'icp', 'a.log'], 'tune': ['a.log'], 'simulate': ['b.log'],
    'convert': ['a.log', 'b.log'], 'watch': [], 'calibrate': ['a.log', '--topic', '/a'],
}


@pytest.fixture
def without(root, tmp_path):
    """``without(modules, *words)``: a command where these cannot be imported, in an empty folder."""
    def without(modules, *words):
        environment = os.environ | {'PYTHONPATH': f'{root / "test" / "without"}{os.pathsep}{root}',
                                    'WITHOUT_PACKAGES': ' '.join(modules)}
        return subprocess.run([sys.executable, '-m', 'dbscan_reg_ros', *words], cwd=tmp_path, env=environment,
                              check=False,
                              capture_output=True, text=True, timeout=60)
    return without


@pytest.fixture
def machine(monkeypatch, tmp_path):
    """``machine(prefix, base, ros, managed)``: the Python and the tools of another machine, which has apt."""
    def machine(prefix, base=None, ros=False, managed=True):
        monkeypatch.setattr(sys, 'prefix', prefix)
        monkeypatch.setattr(sys, 'base_prefix', base or prefix)
        monkeypatch.setattr(sys, 'executable', f'{prefix}/bin/python3')
        monkeypatch.setattr(shutil, 'which', lambda name: '/usr/bin/apt' if name == 'apt' else None)
        monkeypatch.setattr(requirements, 'ROS_SETUP', Path('/' if ros else '/nowhere'))
        monkeypatch.setattr(sysconfig, 'get_path', lambda name: str(tmp_path) if managed else '/nowhere')
    (tmp_path / 'EXTERNALLY-MANAGED').touch()
    return machine


@pytest.mark.parametrize('command', ['scan_matcher', 'replay', 'calibrate'])
def test_missing_packages_are_reported_in_one_line_before_any_work(without, tmp_path, command):
    result = without(NEEDS[command], command, *WORDS[command])
    assert (result.returncode, result.stdout) == (1, '') and result.stderr.count('\n') == 1
    assert result.stderr.startswith(f'{command}: needs numpy and scipy and ')
    names = [SOURCES[module].pypi if module != ROS else 'rclpy' for module in NEEDS[command]]
    assert all(name in result.stderr for name in names) and list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('command', ['scan_matcher', 'replay', 'tune', *(
    pytest.param(name, marks=pytest.mark.long) for name in COMMANDS if name not in ('scan_matcher', 'replay', 'tune'))])
def test_a_command_needs_nothing_but_what_it_names(without, command):
    """What fails without all the others has come further than their absence."""
    others = {module for module in SOURCES if module not in NEEDS[command]} | ({ROS} - set(NEEDS[command]))
    result = without(others, command, *WORDS[command], '--help')
    assert result.returncode == 0, result.stderr
    if command in ('replay', 'register', 'compare', 'tune', 'convert'):
        result = without(others, command, *WORDS[command])
        assert 'a.log: no such file here' in result.stderr and result.stderr.count('\n') == 1


def test_a_bag_needs_more_than_a_log(without, tmp_path):
    (tmp_path / 'a.bag').touch()
    result = without(['rosbags', 'tqdm'], 'convert', 'a.bag', 'b.log')
    assert result.stderr.startswith('convert: needs tqdm and rosbags, not installed here: ') and result.returncode == 1


@pytest.mark.parametrize(('words', 'module'), [(['--scheduler', 'tcp://127.0.0.1:1'], 'distributed'),
                                               (['--search', 'optuna'], 'optuna')])
def test_what_an_argument_needs_is_asked_for(without, words, module):
    result = without([module], 'tune', 'a.log', *words)
    assert re.fullmatch(f'tune: needs {module}, not installed here: .* -m pip install {module}\n', result.stderr)


@pytest.mark.parametrize(('words', 'needed'), [
    (['register', 'a.log', '0', '1'], 'matplotlib'), (['register', 'a.log', '0', '1', '--no-figures'], ''),
    (['register', 'a.log', '0', '1', '--no-figures', '--method', 'paper'], 'scikit-learn'),
    (['compare', 'defaults', 'icp', 'a.log'], 'matplotlib'),
    (['compare', 'defaults', 'paper', 'a.log'], 'scikit-learn'),
    (['compare', 'defaults', 'icp', 'a.log', '--method', 'paper'], 'scikit-learn'), (['scan_matcher', '-h'], '')])
def test_pictures_and_the_method_of_the_paper_need_more(without, words, needed):
    result = without(['sklearn', *(['matplotlib'] if needed != 'scikit-learn' else [])], *words)
    assert f'needs {needed}, not installed here' in result.stderr if needed else 'needs' not in result.stderr


def test_a_pair_is_registered_without_what_draws(without, tmp_path):
    room_log(tmp_path / 'room.log', 2)
    result = without(['sklearn', 'matplotlib', 'PIL', 'tqdm', 'rosbags'], 'register', 'room.log', '0', '1',
                     '--no-figures')
    assert (result.returncode, result.stderr) == (0, '') and 'transform   x 0.0000 m  y 0.0000 m' in result.stdout


def test_the_extra_of_the_package_has_what_the_commands_need(root):
    extra = re.search(r'^commands = \[(.*?)\]', (root / 'pyproject.toml').read_text(), re.MULTILINE)[1]
    assert {SOURCES[module].pypi for module in EXTRA} <= set(re.findall(r'"(\w+)"', extra))
    assert {module for needs in NEEDS.values() for module in needs} - {'sklearn', ROS} == {
        'numpy', 'scipy', 'yaml', 'matplotlib', 'tqdm'}


def test_the_system_python_is_served_by_apt_and_a_virtual_environment_by_pip(machine):
    machine('/usr')
    assert missing_line(['tqdm', 'matplotlib']) == ('needs tqdm and matplotlib, not installed here: '
                                                    'sudo apt install python3-tqdm python3-matplotlib')
    machine('/home/me/my env', '/usr')
    assert missing_line(['tqdm', 'rosbags']).endswith(
        f"here: '/home/me/my env/bin/python3' -m pip install tqdm rosbags{WITH_EXTRA}")
    machine('/usr/local', managed=False)
    assert missing_line(['tqdm']).endswith(f'here: /usr/local/bin/python3 -m pip install tqdm{WITH_EXTRA}')


def test_what_ubuntu_has_no_package_of_goes_into_a_virtual_environment(machine, monkeypatch):
    """Its own Python refuses pip."""
    monkeypatch.setenv('HOME', '/home/me')
    machine('/usr')
    assert missing_line(['tqdm', 'rosbags']) == (
        'needs tqdm and rosbags, not installed here: sudo apt install python3-tqdm && /usr/bin/python3 -m venv '
        '--system-site-packages /home/me/.venvs/dbscan_reg_ros && /home/me/.venvs/dbscan_reg_ros/bin/python -m pip '
        f'install rosbags{WITH_EXTRA}')


def test_ros_is_sourced_where_it_is_there_and_comes_as_wheels_where_it_is_not(machine):
    machine('/usr', ros=True)
    assert missing_line(['rclpy']) == 'needs ROS 2 (rclpy), not installed here: source /'
    machine('/venv', '/usr')
    assert missing_line(['nav_msgs']).endswith("pip install 'ros-rclpy[fastrtps]==7.1.6' ros-common-interfaces==5.3.6")


def test_every_name_is_one_that_is_installed_by_it(root):
    """The locks and rosdep keys name the same; rclpy and this package are on no registry."""
    locks = ''.join((root / 'scripts' / 'requirements' / f'{name}.txt').read_text() for name in ('wheels', 'test'))
    locked = {name.lower().replace('_', '-') for name in re.findall(r'^([\w-]+)(?:\[\w+\])?==', locks, re.MULTILINE)}
    names = {source.pypi.lower().replace('_', '-') for source in SOURCES.values()} | {name.split('[')[0].split('=')[0]
                                                                                      for name in ROS_WHEELS}
    assert names <= locked
    manifest = (root / 'package.xml').read_text()
    assert all(f'<exec_depend>{source.ubuntu}</exec_depend>' in manifest
               for source in SOURCES.values() if source.ubuntu)
