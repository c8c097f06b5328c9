# SPDX-License-Identifier: Apache-2.0
"""Commands whose standard output closes, as by ``| head -1``: all results are written; and what cannot be written."""
import io
import os
import shutil
import subprocess
import sys
from contextlib import contextmanager

import pytest
from bags import scan_bag

from dbscan_reg_ros.__main__ import main
from dbscan_reg_ros.commands.processes import package_command


@pytest.fixture(scope='module')
def log(tmp_path_factory):
    file = tmp_path_factory.mktemp('recording') / 'hall.log'
    assert main(['simulate', str(file), '--world', 'hall', '--speed', '2', '--rate', '4', '--seconds', '8']) == 0
    return file


@contextmanager
def closed_output(monkeypatch):
    """Make standard output and error a pipe whose reader has ended, so that the first character printed fails."""
    reader, writer = os.pipe()
    os.close(reader)
    with io.TextIOWrapper(io.FileIO(writer, 'w'), write_through=True) as pipe, monkeypatch.context() as patch:
        with pytest.raises(BrokenPipeError):
            pipe.write('a line')
        patch.setattr(sys, 'stdout', pipe)
        patch.setattr(sys, 'stderr', pipe)
        yield


@pytest.mark.parametrize(('words', 'results'), [
    (['replay', 'LOG', 'LOG', '--processes', '1'], ['results/index.html', 'results/hall/latest/report.html']),
    (['compare', 'dbscan', 'identity', 'LOG', '--processes', '1'],
     [f'results/compare/latest/{name}' for name in ('table.txt', 'comparison.json', 'comparison.png', 'index.html')]),
], ids=lambda value: value[0])
def test_all_results_are_written_whatever_happens_to_the_output(words, results, log, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with closed_output(monkeypatch):
        code = main([str(log) if word == 'LOG' else word for word in words])
    assert [name for name in results if not (tmp_path / name).is_file()] == []
    assert code == (1 if words[0] == 'compare' else 0), 'its own exit status: the motion is worse than the odometry'


@pytest.mark.parametrize(('redirection', 'code', 'said'), [
    ('| head -1; exit ${PIPESTATUS[0]}', 3, ''), ('>&-', 3, ''), ('2>&1 | true; exit ${PIPESTATUS[0]}', 3, ''),
    ('> /dev/full', 1, 'work: standard output: No space left on device\n')])
def test_the_work_goes_on_whatever_happens_to_its_output(redirection, code, said, root, tmp_path):
    program = ('import sys; from dbscan_reg_ros.commands import command_line\n'
               'def work(args):\n'
               '    for _ in range(10_000): print("a line that is not read")\n'
               '    print("to standard error", file=sys.stderr) if sys.argv[1:] else None\n'
               '    open("result", "w").close()\n'
               '    return 3\n'
               'sys.exit(command_line.run(command_line.make_parser("work", "Tests."), work, []))')
    line = f'"$0" -c "$1" {"both" if "2>" in redirection else ""} {redirection}'
    result = subprocess.run(['bash', '-c', line, sys.executable, program], cwd=tmp_path, timeout=60,
                            capture_output=True, text=True, check=False, env=os.environ | {'PYTHONPATH': str(root)})
    assert (result.returncode, result.stderr) == (code, said)
    assert (tmp_path / 'result').is_file()


def test_the_disk_is_full_while_a_replay_is_written(start, scans, root, tmp_path):
    folder = tmp_path / 'full'
    folder.mkdir()
    words = ['unshare', '--mount', '--map-root-user', 'sh', '-c',
             f'mount -t tmpfs -o size=64k none {folder} && exec "$@"', 'sh']
    if not shutil.which('unshare') or os.system(' '.join(map(repr, [*words, 'true']))):
        pytest.skip('needs unshare, and to be allowed to mount')
    process = start(*words, *package_command('replay', scan_bag(tmp_path / 'drive', scans), '--out', folder),
                    PYTHONPATH=str(root))
    assert process.wait(60.0) == 3, process.output()
    faults = [line for line in process.output().splitlines() if ' not written: ' in line]
    assert faults and all(line.endswith(' not written: No space left on device') for line in faults), process.output()
    assert 'ok 80' in process.output() and 'Traceback' not in process.output()


def test_the_folder_of_results_is_read_only(log, capsys):
    assert main(['replay', str(log), '--out', '/sys']) == 2
    line, = capsys.readouterr().err.splitlines()
    assert line.startswith('replay: /sys: cannot be written, ')
