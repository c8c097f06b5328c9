"""Replay: a recording in, a trajectory, a map and a verdict out."""
import gzip
import itertools
import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from dbscan_reg_ros.commands.replay import main
from dbscan_reg_ros.plots import plot_map
from dbscan_reg_ros.recordings import open_recording, read_csv, read_tum
from dbscan_reg_ros.recordings.carmen import CarmenLog


def picture(path):
    """Shares of ink ``(rows, columns)`` of a picture: 0 is white, 1 is black."""
    from matplotlib.image import imread
    return 1.0 - imread(path)[..., :3].mean(axis=2)


@pytest.mark.parametrize(('path', 'count', 'first'), [
    ('lms511/static', 173, 4101310801000),
    ('urg04lx/exp1', 756, 212387282000),
    ('ccny_demo/demo.bag', 360, 1282836370970876375),
    ('aces/aces.log.gz', 440, 21019900000),
])
def test_a_recording_becomes_a_trajectory_and_a_map(data, tmp_path, capsys, path, count, first):
    assert main([path, '--data', str(data), '--out', str(tmp_path / 'out')]) == 0
    stamps, poses = read_tum(tmp_path / 'out' / 'trajectory.tum')
    assert stamps.tolist() == open_recording(data / path).stamps() and len(stamps) == count and stamps[0] == first
    assert poses[0].tolist() == [0.0, 0.0, 0.0] and np.isfinite(poses).all()
    assert {file.name for file in (tmp_path / 'out').iterdir()} == {'trajectory.tum', 'map.png'}
    assert 0.003 < picture(tmp_path / 'out' / 'map.png').mean() < 0.5
    printed = capsys.readouterr().out
    assert f'scans {count} lost 0' in printed
    assert re.search(r'time per scan  median \d+\.\d\d ms, p95 \d+\.\d\d ms', printed)


def test_a_sensor_that_stands_still_stays_where_it_is(data, tmp_path):
    assert main(['lms511/static', '--data', str(data), '--out', str(tmp_path)]) == 0
    _, poses = read_tum(tmp_path / 'trajectory.tum')
    assert np.hypot(poses[:, 0], poses[:, 1]).max() < 2e-3
    assert np.degrees(np.abs(poses[:, 2])).max() < 0.05


def test_the_intel_log_is_scored_by_its_relations(data, tmp_path, capsys):
    assert main(['intel/intel.log.gz', '--data', str(data), '--out', str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert 'scans 5505 lost 0' in printed
    metres, degrees = re.search(r'neighbour relations  mean (\d\.\d+) m (\d\.\d+) deg', printed).groups()
    assert float(metres) < 0.03 and float(degrees) < 0.5


def test_corrected_poses_in_the_log_are_the_truth(data, tmp_path, capsys):
    assert main(['aces/aces.log.gz', '--data', str(data), '--out', str(tmp_path)]) == 0
    assert re.search(r'against the corrected poses  over 1 m \d+\.\d+ m, over 5 m \d+\.\d+ m, ATE \d+\.\d+ m',
                     capsys.readouterr().out)


def test_damaged_lines_and_useless_scans_are_named_and_the_others_used(data, tmp_path, capsys):
    with gzip.open(data / 'intel' / 'intel.log.gz', 'rt') as whole:
        lines = whole.readlines()[:30]
    lines[9] = lines[9][:200] + '\n'
    words = lines[19].split()
    lines[19] = ' '.join([*words[:2], *(['81.83'] * 180), *words[182:]]) + '\n'
    (tmp_path / 'a.log').write_text(''.join(lines))
    assert main([str(tmp_path / 'a.log'), '--out', str(tmp_path / 'out')]) == 0
    printed = capsys.readouterr().out
    assert 'a.log:10: damaged FLASER skipped' in printed
    assert re.search(r'^scan 18 not used: ', printed, re.MULTILINE)
    assert 'scans 28 lost 1 ' in printed
    assert len(read_tum(tmp_path / 'out' / 'trajectory.tum')[0]) == 27


def test_an_interrupted_replay_keeps_what_it_has(data, tmp_path, capsys, monkeypatch):
    def interrupted(self):
        yield from itertools.islice(scans(self), 50)
        raise KeyboardInterrupt

    scans = CarmenLog.scans
    monkeypatch.setattr(CarmenLog, 'scans', interrupted)
    assert main(['intel/intel.log.gz', '--data', str(data), '--out', str(tmp_path)]) == 130
    assert len(read_tum(tmp_path / 'trajectory.tum')[0]) == 50
    assert [file.name for file in tmp_path.iterdir()] == ['trajectory.tum']
    assert capsys.readouterr().err == 'replay: interrupted\n'


def test_ctrl_c_leaves_a_valid_trajectory_and_ends_with_130(data, root, tmp_path):
    with gzip.open(data / 'intel' / 'intel.log.gz', 'rt') as whole:
        (tmp_path / 'long.log').write_text(whole.read() * 20)
    process = subprocess.Popen([sys.executable, '-m', 'dbscan_reg_ros', 'replay', 'long.log'], cwd=tmp_path,
                               env=os.environ | {'PYTHONPATH': str(root)}, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not (tmp_path / 'results' / 'long').exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130 and error == 'replay: interrupted\n'
    stamps, _ = read_tum(tmp_path / 'results' / 'long' / 'trajectory.tum')
    assert len(stamps) < 20 * 5505


def test_walls_are_single_lines_where_the_poses_are_right(data, tmp_path):
    recording = open_recording(data / 'intel' / 'intel.log.gz')
    _, reference = read_csv(data / 'intel' / 'reference.csv')
    for name, poses in (('right', reference), ('wrong', reference + np.linspace(0, 1, 5505)[:, None] * [1, 1, 0.2])):
        plot_map(tmp_path / f'{name}.png', recording.scans(), poses, name)
    right, wrong = (picture(tmp_path / f'{name}.png') for name in ('right', 'wrong'))
    assert right.shape[0] > 1500 and (right > 0.5).mean() > 0.005
    assert (right > 0.1).mean() < 0.8 * (wrong > 0.1).mean()


def test_a_map_of_hardly_anything_is_drawn(tmp_path, data):
    plot_map(tmp_path / 'none.png', [], np.empty((0, 3)))
    scan = next(open_recording(data / 'lms511' / 'static').scans())
    plot_map(tmp_path / 'one.png', [scan], [[0.0, 0.0, 0.0]], truth=np.zeros((1, 3)))
    assert picture(tmp_path / 'none.png').mean() < picture(tmp_path / 'one.png').mean()
