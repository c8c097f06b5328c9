# SPDX-License-Identifier: Apache-2.0
"""Parameter files of sensors: the odometry of a lidar with its own file, the defaults, and every other file."""
import os
from collections import Counter

import numpy as np

from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.methods import BenchmarkError
from dbscan_reg_ros.evaluation.metrics import apart, errors
from dbscan_reg_ros.evaluation.trackers import Ours
from dbscan_reg_ros.paths import ready_made
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.robot.parameter_files import read_parameters
from dbscan_reg_ros.simulation import PRESETS, corridor, follow, hall, rooms, simulate

from .bounds import at_least, at_most
from .report import Report

WORLDS = {'rooms': rooms, 'corridor': corridor, 'hall': hall}
NO_SENSOR = 'paper'
DEFAULTS = 'defaults'
LIDARS_OF = {'lds': ('lds', 'lds_02'), 'rplidar_a': ('rplidar_a', 'rplidar_a1')}
"""File -> lidars that it is for, where these have other names."""
OVER = 1.0
"""The error is that of motions over this distance [m]."""
WIDE = 180.0
"""From this field of view [deg] on, more scans have to be `OK`."""
BOUNDS = {'ratio_defaults': at_most(1.0), 'ratio_best': at_most(1.2)}
OK_BOUNDS = {True: at_least(0.95), False: at_least(0.7)}
"""Whether the field of view is wide -> bound of the fraction of scans that are `OK`."""


def measure(args) -> Report:
    """Drive each lidar through each world, once for each seed."""
    from tqdm import tqdm

    from dbscan_reg_ros.commands.workers import workers

    files = [name for name in ready_made() if name != NO_SENSOR]
    chosen = args.sensor or files
    if unknown := [name for name in chosen if name not in files]:
        raise BenchmarkError(f'--sensor {unknown[0]}: expected {", ".join(files)}')
    lidars = [(file, lidar) for file in chosen for lidar in LIDARS_OF.get(file, (file,))]
    with workers(args.processes or os.cpu_count()) as executor:
        jobs = {pair: [executor.submit(drive, pair[1], world, seed, args, files)
                       for world in WORLDS for seed in range(args.seeds)] for pair in lidars}
        rows = {lidar: judged(file, [job.result() for job in jobs[file, lidar]])
                for file, lidar in tqdm(lidars, 'sensors', unit=' lidars', leave=False, disable=None)}
    bounds = {lidar: BOUNDS | {'ok': OK_BOUNDS[field_of_view(lidar) >= WIDE]} for _, lidar in lidars}
    report = Report()
    report.add_courses('sensors', rows, bounds=bounds)
    return report


def field_of_view(name) -> float:
    """Return the field of view of a lidar [deg]."""
    lidar = PRESETS[name]
    return float(np.degrees(abs(lidar.angle_increment) * lidar.beams))


def drive(lidar, world, seed, args, files) -> dict:
    """Return file -> (errors ``(M,)`` [m] over 1 m, fraction of `OK`) on one drive.

    Files whose limits remove no return of the drive and whose other parameters are equal give equal results: one of
    them is run.
    """
    made = WORLDS[world](seed=seed)
    path = follow(made.tour).until(args.seconds + PRESETS[lidar].duration)
    simulation = simulate(made, path, PRESETS[lidar], seed)
    scans = simulation.scans[:args.limit]
    ranges = np.concatenate([scan.ranges[scan.valid] for scan in scans])
    found, results = {}, {}
    for file in (DEFAULTS, *files):
        parameters = Parameters() if file == DEFAULTS else read_parameters(file)
        limits = parameters.scan
        used = ranges >= limits.range_min
        if limits.range_max:
            used &= ranges <= limits.range_max
        key = (limits.noise_min, limits.noise_max, limits.direction)
        key += () if used.all() else (limits.range_min, limits.range_max)
        if key not in found:
            found[key] = followed(scans, simulation.truth[:len(scans)], parameters)
        results[file] = found[key]
    return results


def followed(scans, truth, parameters):
    """Run the odometry over a drive; return the errors over 1 m ``(M,)`` [m] and the fraction of `OK`."""
    track = Ours(parameters)
    steps = [track.process(scan) for scan in scans]
    poses = np.array([step.pose.as_tuple() for step in steps])
    first, last = apart(truth, OVER)
    metres, _ = errors(relative(poses[first], poses[last]), relative(truth[first], truth[last]))
    return metres, float(np.mean([step.status is Status.OK for step in steps]))


def judged(file, drives) -> dict:
    """Return the figures of a lidar with its `file`, over all drives.

    ``rpe_1m_m``: mean error over 1 m with the file; ``defaults_m``: with the defaults; ``best_m``: with the best of all
    files; ``ratio_defaults`` and ``ratio_best``: the first by the others; ``equal_count``: drives on which the file and
    the defaults give the same; ``worse_count``: drives on which the file is worse by more than a fifth.
    """
    mean = {name: float(np.mean(np.concatenate([drive[name][0] for drive in drives]))) for name in drives[0]}
    best = min(mean[name] for name in mean if name != DEFAULTS)
    single = Counter(_compared(drive[file][0].mean(), drive[DEFAULTS][0].mean()) for drive in drives)
    return {'rpe_1m_m': mean[file], 'defaults_m': mean[DEFAULTS], 'best_m': best,
            'ratio_defaults': mean[file] / mean[DEFAULTS], 'ratio_best': mean[file] / best,
            'drives_count': len(drives), 'equal_count': single['equal'], 'worse_count': single['worse'],
            'ok': float(np.mean([drive[file][1] for drive in drives]))}


def _compared(error, other):
    return 'equal' if error == other else 'worse' if error > 1.2 * other else 'better or similar'
