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
@pytest.mark.parametrize('seed', ['-1'])
def test_a_seed_is_a_whole_number_from_0_on(words, seed, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*words, '--seed', seed])
    assert stop.value.code == 2
    assert f'{seed!r}: expected a whole number from 0 to 4294967295' in capsys.readouterr().err


def test_bad_input_is_one_line_and_2(shell, tmp_path):
    result = shell('replay', 'absent.log')
    assert result.returncode == 2 and result.stdout == ''
    assert result.stderr.startswith('replay: absent.log: no such file here') and result.stderr.count('\n') == 1
    assert list(tmp_path.iterdir()) == []


def test_verbose_shows_where_an_error_comes_from(shell):
    result = shell('replay', '-v', 'absent.log')
    assert result.returncode == 2
    assert result.stderr.startswith('Traceback') and result.stderr.count('find_recording') >= 1
    assert result.stderr.splitlines()[-1].startswith('replay: absent.log: no such file here')


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


@pytest.mark.usefixtures('unraisable')
def test_a_signal_is_an_interruption_whatever_error_a_library_raises():
    usual = signal.getsignal(signal.SIGUSR1)
    with pytest.raises(KeyboardInterrupt), interruptible(signal.SIGUSR1):
        try:
            signal.raise_signal(signal.SIGUSR1)
        except KeyboardInterrupt:
            raise RuntimeError('unable to convert') from None
    assert signal.getsignal(signal.SIGUSR1) == usual
    with pytest.raises(RuntimeError), interruptible(signal.SIGUSR1):
        raise RuntimeError('no signal came')


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


def test_errors_of_finalizers_are_printed_unless_a_signal_came(unraisable):
    with interruptible(signal.SIGUSR1):
        pass
    assert sys.unraisablehook is unraisable


@pytest.mark.long
@pytest.mark.parametrize(('number', 'code', 'lines'), [
    (signal.SIGUSR1, 130, ['work: interrupted']),
    (signal.SIGUSR2, 1, ['work: internal error: a mistake (-v shows where)', 'Exception ignored in',
                         "AttributeError: 'Task' object has no attribute 'exception'"])])
def test_an_object_interrupted_in_its_constructor_ends_without_a_word(root, number, code, lines):
    """As a task of rclpy, whose finalizer uses what its constructor had not yet set."""
    program = f"""
import signal, sys
from dbscan_reg_ros.commands import command_line
from dbscan_reg_ros.endings import interruptible

class Task:
    def __init__(self):
        signal.raise_signal({int(number)})
        self.exception = None

    def __del__(self):
        print(self.exception)

def mistake(*_):
    raise ValueError('a mistake')

def work(args):
    with interruptible(signal.SIGUSR1):
        Task()

signal.signal(signal.SIGUSR2, mistake)
sys.exit(command_line.run(command_line.make_parser('work', 'Tests.'), work, []))
"""
    result = subprocess.run([sys.executable, '-c', program], cwd=root, timeout=60, capture_output=True, text=True,
                            check=False)
    assert result.returncode == code and not result.stdout
    assert all(line in result.stderr for line in lines)
    assert len(lines) > 1 or result.stderr.splitlines() == lines


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


def test_the_package_imports_nothing_heavy(root):
    """Only what reads YAML files imports yaml."""
    code = ('import sys, dbscan_reg_ros as package; light = set(sys.modules);'
            '[getattr(package, name) for name in package.__all__ if name != "read_parameters"];'
            'print(sorted({"numpy"} & light), sorted({"rclpy", "rosbags", "matplotlib", "sklearn", "tqdm", "yaml"}'
            ' & set(sys.modules)))')
    result = subprocess.run([sys.executable, '-c', code], cwd=root, capture_output=True, text=True, check=True)
    assert result.stdout == '[] []\n'


def test_recordings_import_no_reader_before_it_is_needed(root):
    code = ('import sys, dbscan_reg_ros.recordings, dbscan_reg_ros.figures.plots, dbscan_reg_ros.commands.replay;'
            'print(sorted({"rclpy", "rosbags", "matplotlib", "sklearn", "scipy", "tqdm"} & set(sys.modules)))')
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
@pytest.mark.parametrize('place', ['file/deep/out'])
def test_what_cannot_be_written_is_refused_before_any_work(shell, tmp_path, words, place):
    (tmp_path / 'file').write_text('')
    (tmp_path / 'a.log').write_text('FLASER 2 1.0 1.0 0 0 0 0 0 0 1.0 host 1.0\n')
    result = shell(*words, place)
    assert (result.returncode, result.stdout) == (2, '') and result.stderr.count('\n') == 1
    assert place in result.stderr or str(os.path.dirname(place)) in result.stderr
    assert {path.name for path in tmp_path.iterdir()} == {'file', 'a.log'}
