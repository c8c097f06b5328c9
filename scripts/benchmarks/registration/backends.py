# SPDX-License-Identifier: Apache-2.0
"""Processor time of the compiled steps beside the reference: both take turns on the same scans."""
import itertools
import math
import time

import numpy as np

from dbscan_reg_ros import Odometry, ParameterError, extract_features, register
from dbscan_reg_ros.backend_choice import compiled_backend
from dbscan_reg_ros.core.backend import REFERENCE
from dbscan_reg_ros.recordings import open_recording
from dbscan_reg_ros.simulation import Lidar, follow, rooms, simulate

from ..intel import Intel
from ..report import Report
from . import pairs

SCANS, PAIRS, SKIPPED = 500, 60, 20
"""Scans of a drive, pairs, and scans at the beginning that are not timed."""
BEAMS = 181, 1081, 2161
FIELD = math.radians(270.0)


def simulated(beams, count):
    """Return scans of a drive through rooms, with a field of view of 270 deg."""
    world = rooms(seed=1)
    lidar = Lidar(beams=beams, angle_min=-0.5 * FIELD, angle_increment=FIELD / (beams - 1))
    return simulate(world, follow(world.tour, speed=1.0), lidar, seed=1).scans[:count]


def timed(work):
    """Return the result of a call, and its processor time [ms]."""
    start = time.thread_time()
    result = work()
    return result, 1e3 * (time.thread_time() - start)


def ratios(times):
    """Metrics of the times ``(N, 2)`` of the compiled steps and of the reference [ms]."""
    compiled, reference = np.array(times).T
    return {'ms_compiled': np.median(compiled), 'ms_reference': np.median(reference),
            'ratio_median': np.median(compiled) / np.median(reference),
            'ratio_mean': compiled.mean() / reference.mean()}


def registrations(trials, compiled):
    """Features of both scans of each pair and their registration without an initial guess."""
    times, differences = [], []
    for trial in trials:
        results = [timed(lambda backend=backend, trial=trial: register(
            extract_features(trial.reference, backend=backend), extract_features(trial.current, backend=backend)))
            for backend in (compiled, REFERENCE)]
        times.append([spent for _, spent in results])
        (one, _), (other, _) = results
        differences.append(_distance(one.transform, other.transform))
    return ratios(times) | {'largest_difference_m': max(differences)}


def drives(scans, compiled):
    """Odometry, scan by scan."""
    odometries = [Odometry(backend=backend) for backend in (compiled, REFERENCE)]
    times, differences, decisions = [], [0.0], 0
    for number, scan in enumerate(scans):
        results = [timed(lambda odometry=odometry, scan=scan: odometry.process(scan)) for odometry in odometries]
        (one, _), (other, _) = results
        differences.append(_distance(one.pose, other.pose))
        decisions += (one.status, one.reference_changed) != (other.status, other.reference_changed)
        if number >= min(SKIPPED, len(scans) // 2):
            times.append([spent for _, spent in results])
    return ratios(times) | {'largest_difference_m': max(differences), 'different_count': decisions}


def _distance(one, other):
    return math.hypot(one.x - other.x, one.y - other.y)


def measure(args):
    """Return a `Report`."""
    compiled = compiled_backend()
    if compiled is None:
        raise ParameterError('the compiled steps are not built: python setup.py build_ext --inplace')
    intel, count = Intel.below(args.data), args.limit or SCANS
    rows = {'pairs_180': registrations(pairs.trials(intel, args.limit or PAIRS), compiled)}
    log = itertools.islice(open_recording(intel.folder / 'intel.log.gz').scans(), count)
    rows['intel_180'] = drives(list(log), compiled)
    for beams in BEAMS:
        rows[f'rooms_{beams}'] = drives(simulated(beams, count), compiled)
    report = Report()
    report.add('backends', rows, {})
    return report
