# SPDX-License-Identifier: Apache-2.0
"""The demo: the whole chain in processes of its own, and nothing left of it afterwards."""
import gzip
import itertools
import os
import re
import shutil
import signal
import subprocess
import time

import numpy as np
import pytest
from bags import needs_rosbags, scan_bag
from events import Reader

from dbscan_reg_ros.__main__ import main
from dbscan_reg_ros.commands.processes import Process
from dbscan_reg_ros.recordings import open_recording, read_tum


@pytest.fixture
def demo(start_command, tmp_path):
    """``demo(*words)``: start the demo with a results folder in the test's own."""
    return lambda *words: start_command('demo', '--out', tmp_path / 'out', *words)


def node_of(process, deadline):
    """The number of the node's process, once the demo has said it."""
    return int(when(lambda: re.search(r'node +process (\d+)', process.output()), deadline, process)[1])


def when(condition, deadline, process):
    """What `condition` gives as soon as it holds."""
    end = time.monotonic() + deadline
    while not (result := condition()):
        assert process.running() and time.monotonic() < end, process.output()
        time.sleep(0.01)
    return result


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


@pytest.mark.long
def test_a_map_that_cannot_be_drawn_costs_no_result(demo, scans, tmp_path):
    (tmp_path / 'out' / 'map.png').mkdir(parents=True)
    process = demo(scan_bag(tmp_path / 'drive', scans[:20]))
    assert process.wait(120) == 0, process.output()
    assert len(read_tum(tmp_path / 'out' / 'trajectory.tum')[0]) == 20
    said = process.output().splitlines()
    assert said[-1] == 'scans 20 skipped 0'
    assert len([line for line in said if line.startswith('demo: map.png not written: ')
                and 'Is a directory' in line]) == 1


def test_the_simulated_building_ends_within_2_percent_of_its_path(demo, tmp_path):
    process = demo()
    node = node_of(process, 60.0)
    assert process.wait(120.0) == 0, process.output()
    last = process.output().splitlines()[-1]
    count, lost, path, metres, share = re.fullmatch(
        r'scans (\d+) skipped (\d+) path ([\d.]+) m final error ([\d.]+) m \(([\d.]+) %\) [\d.]+ deg', last).groups()
    assert int(count) > 500 and int(lost) == 0 and float(path) > 50.0
    assert float(metres) < 0.02 * float(path) and float(share) < 2.0
    stamps, poses = read_tum(tmp_path / 'out' / 'trajectory.tum')
    assert len(stamps) == int(count) and poses[0].tolist() == [0.0, 0.0, 0.0]
    assert (tmp_path / 'out' / 'map.png').stat().st_size > 10_000
    assert not alive(node)


@needs_rosbags
def test_every_scan_of_a_recording_is_answered_with_its_stamp(demo, beginning, root, tmp_path):
    """Also with the file of defaults, by which the laser's place is read from transforms."""
    process = demo('urg04lx/exp1', '--data', beginning, '--params-file', root / 'config' / 'scan_matcher.yaml')
    assert process.wait(120.0) == 0, process.output()
    stamps, poses = read_tum(tmp_path / 'out' / 'trajectory.tum')
    assert stamps.tolist() == open_recording(beginning / 'urg04lx' / 'exp1').stamps() and len(stamps) > 190
    assert process.output().splitlines()[-1] == f'scans {len(stamps)} skipped 0'
    assert np.isfinite(poses).all()


@pytest.mark.long
def test_the_intel_log_is_answered_scan_by_scan_and_scored_by_its_relations(demo, data, tmp_path):
    with gzip.open(data / 'intel' / 'intel.log.gz', 'rt') as whole:
        (tmp_path / 'intel.log').write_text(''.join(itertools.islice(whole, 1001)))
    shutil.copy(data / 'intel' / 'intel.relations', tmp_path)
    process = demo(tmp_path / 'intel.log')
    assert process.wait(180.0) == 0, process.output()
    metres, degrees = re.fullmatch(r'scans 1000 skipped 0 neighbours (\d\.\d{3}) m (\d\.\d{2}) deg',
                                   process.output().splitlines()[-1]).groups()
    assert float(metres) < 0.03 and float(degrees) < 0.5


@pytest.mark.parametrize(('number', 'stage'), [(signal.SIGINT, 'starting'), (signal.SIGTERM, 'playing'), *(
    pytest.param(number, stage, marks=pytest.mark.long) for number, stage in (
        (signal.SIGHUP, 'starting'), (signal.SIGINT, 'playing')))])
def test_a_signal_ends_the_demo_and_its_node(demo, tmp_path, number, stage):
    process = demo()
    node = node_of(process, 60.0)
    if stage == 'playing':
        when(lambda: 'ready' in (tmp_path / 'out' / 'scan_matcher.log').read_text(), 30.0, process)
    process.signal(number)
    assert process.wait(15.0) == 130, process.output()
    assert process.output().splitlines()[-1] == 'demo: interrupted'
    assert not alive(node)


@pytest.mark.parametrize(('parameters', 'words', 'says'), [
    ('advanced.rotation.eps: -1.0', (), r'.*own\.yaml: advanced\.rotation\.eps = -1\.0: expected .*'),
    ('scan_topics: [front, rear]', (), r'the simulated building has one lidar, not 2; .* topics /front, /rear'),
    ('', ('absent.log',), 'absent.log: no such file here.*')])
def test_what_cannot_be_shown_is_refused_in_one_line_before_anything_starts(tmp_path, capsys, parameters, words, says):
    (tmp_path / 'own.yaml').write_text(f'scan_matcher: {{ros__parameters: {{{parameters}}}}}')
    assert main(['demo', '--out', str(tmp_path / 'out'), '--params-file', str(tmp_path / 'own.yaml'), *words]) == 2
    assert re.fullmatch(f'demo: {says}\n', capsys.readouterr().err) and not (tmp_path / 'out').exists()


def test_a_process_that_ignores_signals_is_stopped_with_its_children(tmp_path):
    stubborn = 'trap "" INT TERM; sleep 600 & echo $!; wait; while :; do sleep 1; done'
    process = Process(['bash', '-c', stubborn], tmp_path / 'log')
    child = int(when(process.output, 10.0, process))
    assert process.stop(patience=0.2) == -signal.SIGKILL
    assert not process.running()
    end = time.monotonic() + 5.0
    while alive(child) and subprocess.run(['ps', '-o', 'stat=', str(child)], capture_output=True, text=True,
                                          check=False).stdout.strip() not in ('', 'Z'):
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.mark.long
def test_the_live_demo_ends_if_its_node_ends_before_the_page_is_opened(demo, scans, tmp_path):
    process = demo(scan_bag(tmp_path / 'drive', scans[:30]), '--live')
    when(lambda: 'open the page: the drive begins then' in process.output(), 60, process)
    os.kill(node_of(process, 1.0), signal.SIGKILL)
    assert process.wait(30) == 2, process.output()
    assert re.fullmatch(r'demo: .* -m dbscan_reg_ros scan_matcher --ros-args .*has ended with exit status -9; '
                        r'its output is in .*scan_matcher\.log', process.output().splitlines()[-1])


def test_the_live_demo_begins_when_a_browser_shows_its_page(demo, scans, tmp_path):
    (tmp_path / 'patient.yaml').write_text('/**: {ros__parameters: {advanced.input.queue_size: 30}}')
    process = demo(scan_bag(tmp_path / 'drive', scans[:30]), '--live', '--params-file', str(tmp_path / 'patient.yaml'))
    port = int(when(lambda: re.search(r'page +http://127\.0\.0\.1:(\d+)/', process.output()), 60, process)[1])
    when(lambda: 'open the page: the drive begins then' in process.output(), 60, process)
    reader = Reader('127.0.0.1', port)
    while reader.next('start')[1]['source'] != '/scan_matcher':
        pass
    assert len(reader.next('scan')[1]['pose']) == 3
    reader.close()
    assert process.wait(120) == 0, process.output()
    assert process.output().splitlines()[-1] == 'scans 30 skipped 0'
