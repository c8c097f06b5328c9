# SPDX-License-Identifier: Apache-2.0
"""Ctrl-C, and other ends from outside, of commands that start processes.

All have ended soon, and what was done is kept.
"""
import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from bags import messages, needs_rosbags

from dbscan_reg_ros.commands.simulate import main as simulate
from dbscan_reg_ros.recordings import read_tum

needs_ros = pytest.mark.skipif(importlib.util.find_spec('rclpy') is None, reason='needs ROS 2 (rclpy)')
STARTED, ENDED = 90.0, 60.0
"""Patience [s]."""
LAPS = 10


def children(pid):
    """The processes below that of the number."""
    found = [int(word) for task in Path(f'/proc/{pid}/task').iterdir()
             for word in (task / 'children').read_text().split()]
    return found + [deeper for child in found for deeper in children(child)]


def running(pid):
    """Whether the process runs; a zombie does not."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except (FileNotFoundError, ProcessLookupError):
        return False


def pending(pid, number):
    """Whether a signal is still to be taken by a process."""
    masks = re.findall(r'(?:Shd|Sig)Pnd:\t(\w+)', Path(f'/proc/{pid}/status').read_text())
    return any(int(mask, 16) >> (number - 1) & 1 for mask in masks)


def wait_until(true, patience):
    deadline = time.monotonic() + patience
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.fixture(scope='module')
def recordings(tmp_path_factory):
    """Two drives that keep the odometry busy for much longer than an interruption takes."""
    folder = tmp_path_factory.mktemp('recordings')
    files = [folder / 'a.log', folder / 'b.log']
    for seed, file in enumerate(files):
        assert simulate([str(file), '--world', 'hall', '--speed', '4', '--rate', '5', '--seed', str(seed)]) == 0
        lines = file.read_text().splitlines()
        file.write_text(''.join(f'{later(line, 200.0 * k)}\n' for k in range(LAPS) for line in lines))
    return files


def later(line, seconds):
    """The line of a CARMEN log with its stamps so much later."""
    words = line.split(' ')
    if words[0].endswith('LASER1'):
        words[-3], words[-1] = (f'{float(words[at]) + seconds:.3f}' for at in (-3, -1))
    return ' '.join(words)


@pytest.fixture
def begun(root, tmp_path):
    """``begun(ready, *words)``: a command of the package once it is `ready()` and has workers."""
    begun = []

    def begin(ready, *words, workers=2):
        process = subprocess.Popen([sys.executable, '-m', 'dbscan_reg_ros', *map(str, words)], cwd=tmp_path, text=True,
                                   env=os.environ | {'PYTHONPATH': str(root)},
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        begun.append(process)
        wait_until(lambda: (process.poll() is None or pytest.fail(process.communicate()[1]))
                   and len(children(process.pid)) >= workers and ready(), STARTED)
        return process
    yield begin
    for process in begun:
        for pid in children(process.pid) if process.poll() is None else ():
            os.kill(pid, signal.SIGKILL)
        process.kill()
        process.wait()


def interrupted(process, number=signal.SIGINT):
    """Send the signal: the status, the output and the errors; all processes have ended."""
    below = children(process.pid)
    process.send_signal(number)
    output, errors = process.communicate(timeout=ENDED)
    wait_until(lambda: not any(map(running, below)), ENDED)
    return process.returncode, output, errors


@pytest.mark.parametrize('command, status', [('replay', 130), pytest.param('play', 0, marks=needs_ros)])
def test_an_interruption_while_modules_are_imported_ends_without_a_traceback(begun, command, status):
    process = begun(lambda: True, command, 'absent.log', workers=0)
    wait_until(lambda: process.poll() is not None
               or 'SigBlk:\t0000000000004002' in Path(f'/proc/{process.pid}/status').read_text(),
               STARTED)
    assert interrupted(process) == (status, '', f'{command}: interrupted\n')


@pytest.mark.parametrize('number', [signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.long)],
                         ids=lambda number: number.name)
def test_an_interrupted_search_ends_at_once_and_keeps_its_trials(begun, recordings, tmp_path, number):
    short, lines = tmp_path / 'short.log', recordings[0].read_text().splitlines(keepends=True)
    short.write_text(''.join(lines[:len(lines) // (4 * LAPS)]))
    trials = tmp_path / 'out' / 'trials.jsonl'
    words = ['tune', short, '--trials', '200', '--search', 'random', '--out', 'out', '--processes', '2']
    process = begun(lambda: trials.exists() and trials.read_bytes().count(b'\n') >= 3, *words)
    code, output, errors = interrupted(process, number)
    kept = [json.loads(line)['number'] for line in trials.read_text().splitlines()]
    assert (code, errors) == (130, 'tune: interrupted\n') and len(set(kept)) == len(kept) >= 3
    assert f'kept        {len(kept)} of 200 trials in out; the same command continues from there' in output


@needs_rosbags
def test_an_interrupted_replay_ends_at_once_with_what_it_has(begun, recordings, tmp_path):
    def replaying():
        return len([bag for bag in tmp_path.glob('results/*/*/bag/*.mcap') if bag.stat().st_size]) == 2

    process = begun(replaying, 'replay', *recordings, '--processes', '2')
    assert interrupted(process) == (130, '', 'replay: interrupted\n')
    tracks = list(tmp_path.glob('results/*/*/trajectory.tum'))
    assert len(tracks) == 2
    for track in tracks:
        assert len(messages(track.parent / 'bag')) == 3 * len(read_tum(track)[0]) > 0


@pytest.mark.long
def test_no_worker_outlives_a_command_that_is_killed(begun, recordings):
    process = begun(lambda: True, 'compare', 'defaults', 'icp', *recordings, '--processes', '2')
    below = children(process.pid)
    process.kill()
    process.communicate()
    wait_until(lambda: not any(map(running, below)), ENDED)


@pytest.mark.long
def test_a_second_interruption_does_not_wait_for_the_first(begun, recordings):
    process = begun(lambda: True, 'compare', 'defaults', 'icp', *recordings, '--processes', '2')
    below = children(process.pid)
    process.send_signal(signal.SIGINT)
    wait_until(lambda: not pending(process.pid, signal.SIGINT), ENDED)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=ENDED)
    assert process.returncode != 0
    wait_until(lambda: not any(map(running, below)), ENDED)
