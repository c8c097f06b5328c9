# SPDX-License-Identifier: Apache-2.0
"""What all commands share: quick help, one-line errors, exit codes, nothing imported that is not needed."""
import importlib.util
import os
import shlex
import signal
import subprocess
import sys
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path

import pytest
from rooms import room_log

from dbscan_reg_ros import RecordingError
from dbscan_reg_ros.__main__ import main
from dbscan_reg_ros.command_lines import COMMANDS
from dbscan_reg_ros.commands import command_line
from dbscan_reg_ros.endings import held, interruptible
from dbscan_reg_ros.requirements import WITH_EXTRA

needs_ros = pytest.mark.skipif(importlib.util.find_spec('rclpy') is None, reason='needs ROS 2 (rclpy)')


@pytest.fixture
def shell(root, tmp_path):
    """``shell('replay', ...)``: run a command of the package to its end, in an empty folder."""
    def shell(*words):
        return subprocess.run([sys.executable, '-m', 'dbscan_reg_ros', *map(str, words)], cwd=tmp_path, timeout=120,
                              capture_output=True, text=True, check=False, env=os.environ | {'PYTHONPATH': str(root)})
    return shell


def run(work, *argv):
    return command_line.run(command_line.make_parser('work', 'Tests.'), work, argv)


@pytest.mark.parametrize('command', [(), ('replay',), ('scan_matcher',), *(
    pytest.param((name,), marks=pytest.mark.long) for name in COMMANDS if name not in ('replay', 'scan_matcher'))],
    ids=lambda words: ' '.join(words) or 'all')
def test_help_imports_nothing_heavy(root, command):
    words = [sys.executable, '-X', 'importtime', '-m', 'dbscan_reg_ros', *command, '--help']
    result = subprocess.run(words, cwd=root, timeout=120, capture_output=True, text=True, check=True)
    typed = ' '.join((Path(sys.executable).name, '-m', 'dbscan_reg_ros', *command))
    assert result.stdout.startswith(f'usage: {typed} ')
    imported = {line.rpartition('|')[2].strip().partition('.')[0] for line in result.stderr.splitlines()}
    assert 'argparse' in imported
    assert not imported & {'numpy', 'scipy', 'sklearn', 'matplotlib', 'rosbags', 'rclpy', 'tqdm', 'yaml', 'distributed'}


def test_the_overview_names_every_command(capsys):
    with pytest.raises(SystemExit) as stop:
        main(['--help'])
    assert stop.value.code == 0
    overview = capsys.readouterr().out
    assert all(f'\n  {name} ' in overview and summary in overview for name, (_, summary) in COMMANDS.items())


def test_neither_the_backend_of_jupyter_nor_an_old_terminal_matter(shell, tmp_path, monkeypatch):
    monkeypatch.setenv('MPLBACKEND', 'module://matplotlib_inline.backend_inline')
    monkeypatch.setenv('PYTHONIOENCODING', 'ascii')
    room_log(tmp_path / 'b\u00fcro.log', 3)
    result = shell('register', 'b\u00fcro.log', 0, 2)
    assert (result.returncode, result.stderr) == (0, '') and 'figures     results/b?ro_0_2/' in result.stdout
    assert (tmp_path / 'results' / 'b\u00fcro_0_2' / 'latest' / 'sheet.png').exists()


@pytest.mark.parametrize('argv', [[], ['replai'], ['replay'], ['replay', 'a.log', '--nonsense']])
def test_wrong_usage_ends_with_2(argv, capsys):
    with pytest.raises(SystemExit) as stop:
        main(argv)
    assert stop.value.code == 2
    assert 'usage: ' in capsys.readouterr().err


@pytest.mark.parametrize('words', [['simulate', 'a.log'], ['tune', 'a.log'], ['compare', 'defaults', 'icp', 'a.log']])
def test_a_seed_is_a_whole_number_from_0_on(words, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*words, '--seed', '-1'])
    assert stop.value.code == 2
    assert "'-1': expected a whole number from 0 to 4294967295" in capsys.readouterr().err


def test_bad_input_is_one_line_and_2_and_verbose_shows_where_it_comes_from(shell, tmp_path):
    short, long = shell('replay', 'absent.log'), shell('replay', '-v', 'absent.log')
    assert (short.returncode, long.returncode, short.stdout) == (2, 2, '') and list(tmp_path.iterdir()) == []
    assert short.stderr.startswith('replay: absent.log: no such file here') and short.stderr.count('\n') == 1
    assert long.stderr.startswith('Traceback') and long.stderr.endswith(short.stderr)


@pytest.mark.parametrize(('error', 'code', 'line'), [
    (RecordingError('a.log: empty'), 2, 'work: a.log: empty\n'),
    (KeyboardInterrupt(), 130, 'work: interrupted\n'),
    (PermissionError(13, 'Permission denied', 'out/a'), 1, 'work: out/a: Permission denied\n'),
    (ModuleNotFoundError('no', name='rosbags'), 1,
     f'work: needs rosbags, not installed here: {shlex.quote(sys.executable)} -m pip install rosbags{WITH_EXTRA}\n'),
    (BrokenProcessPool('terminated abruptly'), 1,
     'work: a worker process was killed, possibly for lack of memory: use fewer --processes\n'),
    (ZeroDivisionError('by zero'), 1, 'work: internal error: by zero (-v shows where)\n'),
])
def test_every_failure_has_one_line_and_a_code(capsys, error, code, line):
    def work(args):
        raise error
    assert run(work) == code
    assert capsys.readouterr().err == line


@pytest.fixture
def unraisable(monkeypatch):
    """The handler of errors in finalizers, which is put back at the end of the test."""
    monkeypatch.setattr(sys, 'unraisablehook', sys.unraisablehook)
    return sys.unraisablehook


def test_a_signal_is_an_interruption_whatever_a_library_raises_or_prints_then(unraisable, capsys):
    """As rclpy, whose finalizers use what an interrupted constructor has not set; without a signal all is as usual."""
    class Task:
        def __init__(self):
            signal.raise_signal(signal.SIGUSR1)
            self.exception = None

        def __del__(self):
            print(self.exception)

    usual = signal.getsignal(signal.SIGUSR1)
    with pytest.raises(RuntimeError), interruptible(signal.SIGUSR1):
        raise RuntimeError('no signal came')
    assert sys.unraisablehook is unraisable
    with pytest.raises(KeyboardInterrupt), interruptible(signal.SIGUSR1):
        try:
            Task()
        except KeyboardInterrupt:
            raise RuntimeError('unable to convert') from None
    assert signal.getsignal(signal.SIGUSR1) == usual and ''.join(capsys.readouterr()) == ''


@pytest.mark.usefixtures('unraisable')
def test_a_signal_that_is_held_counts_once_the_block_is_over():
    done = []
    with pytest.raises(KeyboardInterrupt), interruptible(signal.SIGUSR1), held(signal.SIGUSR1):
        signal.raise_signal(signal.SIGUSR1)
        done.append('all')
    assert done == ['all']


def test_an_ignored_signal_stays_ignored():
    """As nohup wants it."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruptible(signal.SIGHUP):
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_reader_that_goes_away_ends_the_command_without_a_word(root):
    code = ('import sys; from dbscan_reg_ros.commands import command_line\n'
            'def work(args):\n    for _ in range(100_000): print("a line that is not read")\n'
            'sys.exit(command_line.run(command_line.make_parser("work", "Tests."), work, [], outlasts=False))')
    with subprocess.Popen([sys.executable, '-c', code], cwd=root, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE) as process:
        assert process.stdout.readline() == b'a line that is not read\n'
        process.stdout.close()
        assert process.stderr.read() == b''
        assert process.wait(60) == 1


@pytest.mark.parametrize('code', [
    'import dbscan_reg_ros as package; assert "numpy" not in sys.modules;'
    '[getattr(package, name) for name in package.__all__ if name != "read_parameters"];'
    'assert "yaml" not in sys.modules',
    'import dbscan_reg_ros.recordings, dbscan_reg_ros.figures.plots, dbscan_reg_ros.commands.replay;'
    'assert "scipy" not in sys.modules'], ids=['package', 'recordings'])
def test_what_is_imported_imports_nothing_heavy(root, code):
    """Only what reads YAML files imports yaml."""
    code = (f'import sys; {code};'
            'print(sorted({"rclpy", "rosbags", "matplotlib", "sklearn", "tqdm"} & set(sys.modules)))')
    result = subprocess.run([sys.executable, '-c', code], cwd=root, capture_output=True, text=True, check=True)
    assert result.stdout == '[]\n'


@pytest.mark.parametrize(('words', 'same'), [
    (['--list', 'a.b', 'FILE'], ['FILE', '--list', 'a.b']),
    (['--list', 'a.b', 'c.d=1:2', 'FILE', 'FILE2', '--other', '1', 'FILE3'],
     ['FILE', 'FILE2', '--list', 'a.b', 'c.d=1:2', '--other', '1', 'FILE3']),
    (['FILE', '--list', 'anything', '--other', '1'], ['FILE', '--list', 'anything', '--other', '1']),
])
def test_a_list_ends_where_something_else_begins(words, same):
    def parsed(words):
        parser = command_line.make_parser('work', 'Tests.')
        parser.add_argument('files', nargs='+')
        parser.add_argument('--other')
        parser.add_argument('--list', nargs='+')
        if words is not same:
            parser.end_list('--list', lambda word: '.' in word)
        return parser.parse_args(words)
    assert parsed(words) == parsed(same) and parsed(words).files[0] == 'FILE'


@pytest.mark.parametrize('words', [['tune', '--parameters', 'advanced.refinement.damping=0.1:1',
                                    'advanced.density.max_distance', 'absent.log'],
                                   ['convert', '--topics', '/scan', '/robot1/odom', 'absent.log', './b.log'],
                                   pytest.param(['play', '--topics', '/cmd_vel', 'absent.log'], marks=needs_ros)])
def test_a_list_before_the_file_does_not_swallow_it(shell, words):
    result = shell(*words)
    assert result.returncode == 2 and result.stderr.count('\n') == 1
    assert 'absent.log: no such file here' in result.stderr


def test_a_slip_in_the_name_of_a_parameter_is_no_file(shell):
    result = shell('tune', '--parameters', 'advanced.refinement.damping', 'refinement.mapscale', 'absent.log')
    assert "did you mean 'advanced.refinement.map_scale'" in result.stderr


@pytest.mark.parametrize('words', [
    ['replay', 'a.log', '--out'], ['compare', 'defaults', 'icp', 'a.log', '--out'], ['tune', 'a.log', '--out'],
    pytest.param(['demo', '--out'], marks=needs_ros), ['register', 'a.log', '0', '1', '--out'],
    ['simulate'], ['convert', 'a.log'],
], ids=lambda words: words[0])
def test_what_cannot_be_written_is_refused_before_any_work(shell, tmp_path, words):
    (tmp_path / 'file').write_text('')
    (tmp_path / 'a.log').write_text('FLASER 2 1.0 1.0 0 0 0 0 0 0 1.0 host 1.0\n')
    result = shell(*words, 'file/deep/out')
    assert (result.returncode, result.stdout) == (2, '') and result.stderr.count('\n') == 1
    assert 'file/deep' in result.stderr
    assert {path.name for path in tmp_path.iterdir()} == {'file', 'a.log'}
