# SPDX-License-Identifier: Apache-2.0
"""What a scan costs the odometry: time beside another commit, and what is called."""
import contextlib
import io
import json
import os
import subprocess
import sys
import tempfile
from itertools import islice
from pathlib import Path

import numpy as np

from dbscan_reg_ros.commands.simulate import main as simulate
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.evaluation.methods import BenchmarkError
from dbscan_reg_ros.recordings import open_recording

from .report import at_most
from .trees import PACKAGE, built, environment, resolved, root

UTM = '--lidar', 'hokuyo_utm30lx', '--world'
SIMULATED = {
    'rooms_1081': (*UTM, 'rooms', '--seconds', '20'),
    'rooms_2161': (*UTM, 'rooms', '--seconds', '12', '--beams', '2161', '--angle-increment', '0.125'),
    'hall_1081': (*UTM, 'hall', '--seconds', '20'),
    'circle': ('--lidar', 'rplidar_s', '--seconds', '40'),
    'corridor': (*UTM, 'corridor', '--people', '3', '--seconds', '20'),
}
SCANS = 1500
"""Number of scans of a recording that are used."""
TURNS = 2
"""Number of times that both trees process a drive, in turn; the least time counts."""
BOUNDS = {'intel': 0.42, 'rooms_1081': 0.39, 'rooms_2161': 0.45, 'hall_1081': 0.42, 'circle': 0.42, 'corridor': 0.35}
"""Largest ratio of the time to that of fdd4aae."""
CALLED = {'functions_count': at_most(80), 'calls_count': at_most(150), 'objects_count': at_most(20)}
FIRST, LAST = 400, 700
"""The scans of Intel in which calls are counted."""
_RECORD = """
import json, sys, time
from itertools import islice
from dbscan_reg_ros.core.odometry.pipeline import Odometry
from dbscan_reg_ros.recordings import open_recording
file, count = sys.argv[1:]
scans, rows = list(islice(open_recording(file).scans(), int(count))), []
for repeats in range(2):
    odometry, rows = Odometry(), []
    for scan in scans:
        began = time.process_time()
        update = odometry.process(scan)
        rows.append((1e3 * (time.process_time() - began), update.status.name))
print(json.dumps(rows))
"""


def add_times(report, commit, folder):
    """Add a table of the processor time of a scan in this tree and in that of another `commit`, drive by drive."""
    name = resolved(commit)
    trees = built(name), root()
    with tempfile.TemporaryDirectory() as scratch:
        rows = {}
        for drive, file in _drives(folder, Path(scratch)).items():
            theirs, ours = (np.min(times, axis=0) for times in zip(
                *([_times(tree, file) for tree in trees] for _ in range(TURNS)), strict=True))
            rows[drive] = {
                'ms_mean': float(ours[0]), 'ms_p99': float(ours[1]), 'ms_degenerate': float(ours[2]),
                'ms_mean_theirs': float(theirs[0]), 'ratio': float(ours[0] / theirs[0])}
    report.add_courses(f'odometry beside {name[:7]}', rows,
                       bounds={drive: {'ratio': at_most(most)} for drive, most in BOUNDS.items()})


def _drives(folder, scratch):
    """Return drive -> recording; simulated ones are written to the folder `scratch`."""
    drives = {'intel': folder / 'intel.log.gz'}
    for name, words in SIMULATED.items():
        with contextlib.redirect_stdout(io.StringIO()):
            simulate([os.fspath(scratch / name), *words])
        drives[name] = scratch / name
    return drives


def _times(tree, file):
    """Return mean, 99th percentile and mean of the degenerate scans of a drive [ms], in a process of its own."""
    done = subprocess.run([sys.executable, '-c', _RECORD, os.fspath(file), str(SCANS)], cwd=tree, env=environment(tree),
                          capture_output=True, text=True, check=False)
    if done.returncode:
        raise BenchmarkError(f'{file}: {done.stderr.strip().splitlines()[-1]}')
    times, statuses = zip(*json.loads(done.stdout), strict=True)
    times, degenerate = np.array(times), np.array(statuses) == 'DEGENERATE'
    return times.mean(), np.percentile(times, 99), times[degenerate].mean() if degenerate.any() else np.nan


def add_calls(report, folder):
    """Add a table of the functions of the package that a tracked scan of Intel enters, of calls and of objects made."""
    odometry, counts = Odometry(), []
    for k, scan in enumerate(islice(open_recording(folder / 'intel.log.gz').scans(), LAST)):
        if k < FIRST:
            odometry.process(scan)
        else:
            counts.append(_counted(odometry, scan))
    names = 'functions_count', 'calls_count', 'objects_count'
    report.add('a tracked scan', {'dbscan': dict(zip(names, np.mean(counts, axis=0).round().astype(int).tolist(),
                                                     strict=True))}, CALLED)


def _counted(odometry, scan):
    """Process a scan; return how many functions were entered, how often, and how many objects were made."""
    calls, objects = [], 0

    def look(frame, event, _):
        nonlocal objects
        if event != 'call':
            return
        code = frame.f_code
        if frame.f_globals.get('__name__', '').startswith(PACKAGE):
            calls.append(code)
        made = frame.f_locals.get('_cls' if code.co_name == '__new__' else 'self')
        kind = made if code.co_name == '__new__' else type(made)
        objects += code.co_name in ('__init__', '__new__') and getattr(kind, '__module__', '').startswith(PACKAGE)

    sys.setprofile(look)
    try:
        odometry.process(scan)
    finally:
        sys.setprofile(None)
    return len(set(calls)), len(calls), objects
