# SPDX-License-Identifier: Apache-2.0
"""The command lines that are shown run as they are, from any folder, with what the user has."""
import os
import subprocess
import sys

import pytest

from dbscan_reg_ros import command_lines
from dbscan_reg_ros.command_lines import ROOT, python_line, started_as, version
from dbscan_reg_ros.commands.command_line import make_parser

ASK = 'import sys; sys.argv[0] = {started!r}; from dbscan_reg_ros.command_lines import command_line; ' \
      'print(command_line("convert", "--version"))'


def said(line, folder, **environment):
    """What the line prints in a shell without PYTHONPATH."""
    plain = {name: value for name, value in os.environ.items() if name not in ('PYTHONPATH', 'VIRTUAL_ENV')}
    return subprocess.run(['bash', '-c', line], cwd=folder, env=plain | environment, capture_output=True, text=True,
                          check=True,
                          timeout=60).stdout


def shown(started, **environment):
    """The line that a process tells which was started as that."""
    return subprocess.run([sys.executable, '-c', ASK.format(started=str(started))], env=os.environ | environment,
                          cwd=ROOT, capture_output=True, text=True, check=True, timeout=60).stdout.strip()


def test_from_a_clone_with_a_difficult_name_it_runs_elsewhere(root, tmp_path):
    clone = tmp_path / "robot's $HOME clone"
    clone.mkdir()
    (clone / 'dbscan_reg_ros').symlink_to(root / 'dbscan_reg_ros')
    (clone / 'package.xml').symlink_to(root / 'package.xml')
    line = subprocess.run([sys.executable, '-c', ASK.format(started='x')], cwd=clone, capture_output=True, text=True,
                          check=True,
                          timeout=60).stdout.strip()
    assert said(line, tmp_path) == f'dbscan_reg_ros {version()}\n'


@pytest.mark.parametrize('on_path', [True, False])
def test_what_pip_has_installed_is_named_by_its_executable(tmp_path, on_path):
    executable = tmp_path / 'my bin' / 'dbscan-reg-ros'
    executable.parent.mkdir()
    executable.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {sys.executable} -m dbscan_reg_ros "$@"\n')
    executable.chmod(0o755)
    path = f'{executable.parent}:{os.environ["PATH"]}' if on_path else os.environ['PATH']
    line = shown(executable, PATH=path)
    assert line == ('dbscan-reg-ros convert --version' if on_path else f"'{executable}' convert --version")
    assert said(line, tmp_path, PATH=path) == f'dbscan_reg_ros {version()}\n'


def test_words_are_quoted_and_the_interpreter_is_this_one(monkeypatch, tmp_path):
    assert said(python_line('-c', 'import sys; print(sys.executable, sys.argv[1:])', "it's", '$HOME *'), tmp_path) == \
        f'{sys.executable} {["it" + chr(39) + "s", "$HOME *"]}\n'
    monkeypatch.setattr(sys, 'argv', ['/opt/ros/jazzy/lib/dbscan_reg_ros/play'])
    assert command_lines.command_line('register', tmp_path / "the robot's.log") == \
        f"ros2 run dbscan_reg_ros register '{tmp_path}/the robot'\"'\"'s.log'"


@pytest.mark.parametrize(('started', 'expected'), [
    ('/ws/install/dbscan_reg_ros/lib/dbscan_reg_ros/replay', 'ros2 run dbscan_reg_ros register'),
    ('/home/me/env/bin/dbscan-reg-ros', 'dbscan-reg-ros register'),
    ('/ws/src/dbscan_reg_ros/dbscan_reg_ros/__main__.py', 'python3 -m dbscan_reg_ros register')])
def test_the_usage_begins_as_the_user_has_typed_it(monkeypatch, capsys, started, expected):
    monkeypatch.setattr(sys, 'argv', [started])
    monkeypatch.setattr(sys, 'executable', '/usr/bin/python3')
    assert started_as('register') == expected and f'{started_as()} register' == expected
    with pytest.raises(SystemExit):
        make_parser('register', 'Tests.').parse_args(['--help'])
    assert capsys.readouterr().out.startswith(f'usage: {expected} [-h]')
    with pytest.raises(SystemExit):
        make_parser('register', 'Tests.').parse_args(['--none'])
    complaint = capsys.readouterr().err.splitlines()
    assert complaint[0].startswith(f'usage: {expected} [-h]') and complaint[-1].startswith('register: error: ')


def test_the_usage_of_a_script_names_the_script(root):
    demo = subprocess.run(['scripts/demo', '--help'], cwd=root, capture_output=True, text=True, check=True, timeout=60)
    assert demo.stdout.startswith('usage: scripts/demo [-h]')
