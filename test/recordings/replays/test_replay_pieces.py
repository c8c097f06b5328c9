# SPDX-License-Identifier: Apache-2.0
"""Every recording at hand, and random pieces of them with a clock that jumps.

A replay ends with a result or one clear line.
"""
import builtins
import dataclasses
import functools
import itertools
import json
import math
import os
import re
from pathlib import Path

import numpy as np
import pytest
from bags import SECOND, write_bag

from dbscan_reg_ros import RecordingError
from dbscan_reg_ros.commands.replay import main
from dbscan_reg_ros.recordings import data_folder, open_recording, read_tum
from dbscan_reg_ros.recordings.bags.with_rosbags import MessageMaker
from dbscan_reg_ros.recordings.message_fields import scan_fields
from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate

pytest.importorskip('rosbags')

PYTHON_NAMES = re.compile('|'.join((r'Traceback', r'weakref', r'\b\w+Error\b', *(
    rf'\b{name}\b' for name, value in vars(builtins).items()
    if isinstance(value, type) and issubclass(value, BaseException) and name != 'Warning'))))
PIECES = 200
SHORTEST, LONGEST = 0.3, 20.0
"""Length of a piece [s]."""
YEAR = 365.25 * 86400.0
LIDARS = {'simulated': None, 'sick': 'intel/intel.log.gz', 'urg': 'urg04lx/exp1', 'handheld': 'ccny_demo/demo.bag'}


def recordings():
    """Every file below ``cases`` and ``data``, and every folder of a bag."""
    try:
        shared = data_folder().parent
    except RecordingError:
        return []
    folders = [shared / name for name in ('cases', 'data')]
    files = sorted(path for folder in folders for path in folder.rglob('*') if path.is_file() and path.suffix != '.md')
    return files + sorted({path.parent for path in files if path.name == 'metadata.yaml'})


def result_or_line(capsys, recording, out):
    """Replay; the folder of the results, or None after one clear line. No name of a Python exception is printed."""
    code = main([str(recording), '--out', str(out), '--processes', '1'])
    printed, said = capsys.readouterr()
    assert not PYTHON_NAMES.search(printed + said), printed + said
    if code:
        line, = said.splitlines()
        assert code == 2 and line.startswith(f'replay: {recording}') and len(line) < 800 and printed == ''
        return None
    assert said == ''
    latest, = out.glob('*/latest')
    assert {'bag', 'map.png', 'metrics.json', 'parameters.yaml', 'report.html', 'trajectory.tum'} <= {
        file.name for file in latest.iterdir()}
    return latest


def checked(folder):
    """The measures of a result whose files agree with one another."""
    stamps, poses = read_tum(folder / 'trajectory.tum')
    metrics = json.loads((folder / 'metrics.json').read_text())
    registered = sum(metrics[status] for status in ('ok', 'degenerate', 'ambiguous', 'failed'))
    assert len(stamps) == metrics['scans'] - metrics['skipped'] == registered >= 2
    assert np.isfinite(poses).all()
    assert all(math.isfinite(metrics[name]) for name in ('driven_m', 'duration_s', 'end_m', 'end_deg'))
    return metrics


@pytest.mark.long
@pytest.mark.parametrize('path', recordings(), ids=lambda path: os.fspath(Path(*path.parts[-2:])))
def test_every_recording_at_hand_ends_with_a_result_or_one_clear_line(path, capsys, tmp_path):
    folder = result_or_line(capsys, path, tmp_path / 'out')
    if folder:
        checked(folder)


@functools.cache
def scans_of(lidar):
    """The first two minutes, or less, of a recording."""
    if lidar == 'simulated':
        world = rooms(seed=3)
        rotating = Lidar(beams=240, angle_min=-math.pi, angle_increment=math.tau / 240, duration=239 / 2400)
        return simulate(world, follow(world.tour[:6], speed=0.8), rotating, seed=3).scans
    return list(itertools.islice(open_recording(data_folder() / LIDARS[lidar]).scans(), 600))


def piece(rng, scans):
    """Scans of a random stretch of time; their usual interval [ns]."""
    stamps = np.maximum.accumulate([scan.stamp for scan in scans])
    length = SECOND * math.exp(rng.uniform(math.log(SHORTEST), math.log(LONGEST)))
    start = rng.uniform(stamps[0], max(stamps[-1] - length, stamps[0] + 1))
    first, last = np.searchsorted(stamps, (start, start + length))
    return scans[first:last]


def jumped(rng, stamps):
    """Stamps [ns] after up to three jumps of the clock: for one scan, or from it on."""
    stamps = np.array(stamps, dtype=np.int64)
    for _ in range(rng.integers(0, 4) if len(stamps) else 0):
        at = rng.integers(len(stamps))
        which = slice(at, at + 1) if rng.random() < 0.5 else slice(at, None)
        kind = rng.choice(['forward', 'back', 'years', 'years back', 'zero'])
        if kind == 'zero':
            stamps[which] = 0
            continue
        seconds = rng.uniform(1.0, 8.0) * YEAR if 'years' in kind else rng.uniform(0.5, 60.0)
        stamps[which] += round((-seconds if 'back' in kind else seconds) * SECOND)
    return np.clip(stamps, 0, (2**31 - 1) * SECOND).tolist()


@pytest.mark.long
@pytest.mark.parametrize('seed', range(PIECES))
def test_a_random_piece_with_a_clock_that_jumps_ends_with_a_result_or_one_clear_line(seed, data, capsys, tmp_path):
    """Two scans or more give a result."""
    rng = np.random.default_rng(seed)
    scans = piece(rng, scans_of(list(LIDARS)[seed % len(LIDARS)]))
    stamps = jumped(rng, [scan.stamp for scan in scans])
    maker = MessageMaker()
    bag = write_bag(tmp_path / 'piece', [
        ('/scan', (k + 1) * SECOND // 10,
         bytes(maker.serialize('sensor_msgs/msg/LaserScan', scan_fields(dataclasses.replace(scan, stamp=stamp)))))
        for k, (scan, stamp) in enumerate(zip(scans, stamps, strict=True))])
    folder = result_or_line(capsys, bag, tmp_path / 'out')
    assert (folder is not None) == (len(scans) >= 2)
    if folder:
        assert checked(folder)['scans'] == len(scans)
        assert read_tum(folder / 'trajectory.tum')[0].tolist() == stamps
