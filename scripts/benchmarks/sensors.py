# SPDX-License-Identifier: Apache-2.0
"""Parameter files of sensors: the odometry of a lidar with its own file, the defaults, and every other file.

Where the surfaces within the range of a lidar do not constrain the motion, as in a corridor without visible ends, the
right status is ``DEGENERATE``, and the error depends on chance more than on the file. So the files are ranked, and
``OK`` is expected, only where the true surfaces constrain the motion.
"""
import math
from collections import Counter
from typing import NamedTuple

import numpy as np

from dbscan_reg_ros.commands.workers import workers
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.core.registration.residuals import CORRIDOR_RATIO
from dbscan_reg_ros.evaluation.methods import BenchmarkError
from dbscan_reg_ros.evaluation.metrics import apart, errors
from dbscan_reg_ros.evaluation.trackers import Ours
from dbscan_reg_ros.paths import ready_made
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.robot.parameter_files import read_parameters
from dbscan_reg_ros.simulation import PRESETS, corridor, follow, hall, rooms, simulate
from dbscan_reg_ros.simulation.raycasting import cast

from .report import Report, at_least, at_most

WORLDS = {'rooms': rooms, 'corridor': corridor, 'hall': hall}
DEFAULTS = 'defaults'
LIDARS_OF = {'lds': ('lds', 'lds_02'), 'rplidar_a': ('rplidar_a', 'rplidar_a1')}
"""File -> lidars that it is for, where these have other names."""
OVER = 1.0
"""The error is that of motions over this distance [m]."""
WIDE = 180.0
"""From this field of view [deg] on, more scans have to be `OK`."""
STEP, GRAZING = 1e-3, 20.0
"""Motion [m] by which the normals of surfaces are found; ranges that change more than `GRAZING` times as much are those
of edges and of surfaces along the beam, and are not used."""
BOUNDS = {'ratio_defaults': at_most(1.0), 'ratio_best': at_most(1.2)}
OK_BOUNDS = {True: at_least(0.95), False: at_least(0.7)}
"""Whether the field of view is wide -> bound of the fraction of the constrained scans that are `OK`."""


class Drive(NamedTuple):
    """The odometry on one drive."""

    metres: np.ndarray
    """Errors of the motions over 1 m [m] ``(M,)``."""
    certain: np.ndarray
    """Whether the true surfaces constrain all scans of each of these motions ``(M,)`` bool."""
    ok: np.ndarray
    """Whether each scan is `OK` ``(N,)`` bool."""
    constrained: np.ndarray
    """Whether the true surfaces constrain it ``(N,)`` bool."""


def measure(args) -> Report:
    """Drive each lidar through each world, once for each seed."""
    from tqdm import tqdm

    files = ready_made()
    chosen = args.sensor or files
    if unknown := [name for name in chosen if name not in files]:
        raise BenchmarkError(f'--sensor {unknown[0]}: expected {", ".join(files)}')
    lidars = [(file, lidar) for file in chosen for lidar in LIDARS_OF.get(file, (file,))]
    with workers(args.processes) as executor:
        jobs = {pair: [executor.submit(drive, pair[1], world, seed, args, files)
                       for world in WORLDS for seed in range(args.seeds)] for pair in lidars}
        rows = {lidar: judged(file, [job.result() for job in jobs[file, lidar]])
                for file, lidar in tqdm(lidars, 'sensors', unit=' lidars', leave=False, disable=None)}
    bounds = {lidar: BOUNDS | {'ok_constrained': OK_BOUNDS[field_of_view(lidar) >= WIDE]} for _, lidar in lidars}
    report = Report()
    report.add_courses('sensors', rows, bounds=bounds)
    return report


def field_of_view(name) -> float:
    """Return the field of view of a lidar [deg]."""
    lidar = PRESETS[name]
    return float(np.degrees(abs(lidar.angle_increment) * lidar.beams))


def constrained(simulation) -> np.ndarray:
    """Return whether the true surfaces constrain each scan ``(N,)``; otherwise the place is like a corridor.

    At least `CORRIDOR_RATIO` of the normals of the surfaces that a scan sees have to lie along each direction.
    """
    world, lidar, found = simulation.world, simulation.lidar, []
    for scan, (*place, heading) in zip(simulation.scans, simulation.truth, strict=True):
        bearings = heading + scan.geometry.bearings
        directions = np.stack((np.cos(bearings), np.sin(bearings)), axis=1)
        ranges, along_x, along_y = (cast(np.array([place]) + step, directions, world.segments, world.circles)
                                    for step in ((0.0, 0.0), (STEP, 0.0), (0.0, STEP)))
        seen = (ranges >= lidar.range_min) & (ranges <= lidar.range_max)
        normals = np.stack((along_x - ranges, along_y - ranges), axis=1)[seen] / STEP
        length = np.hypot(*normals.T)
        normals = (normals / length[:, None])[length < GRAZING]
        found.append(len(normals) and np.linalg.eigvalsh(normals.T @ normals)[0] >= CORRIDOR_RATIO * len(normals))
    return np.array(found, dtype=bool)


def drive(lidar, world, seed, args, files) -> dict:
    """Return file -> `Drive` on one drive.

    Files whose limits remove no return of the drive and whose other parameters are equal give equal results: one of
    them is run.
    """
    made = WORLDS[world](seed=seed)
    path = follow(made.tour).until(args.seconds + PRESETS[lidar].duration)
    simulation = simulate(made, path, PRESETS[lidar], seed)
    scans, mask = simulation.scans[:args.limit], constrained(simulation)[:args.limit]
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
            found[key] = followed(scans, simulation.truth[:len(scans)], mask, parameters)
        results[file] = found[key]
    return results


def followed(scans, truth, mask, parameters) -> Drive:
    """Run the odometry over a drive; `mask` is whether the true surfaces constrain each scan."""
    track = Ours(parameters)
    steps = [track.process(scan) for scan in scans]
    poses = np.array([step.pose.as_tuple() for step in steps])
    first, last = apart(truth, OVER)
    metres, _ = errors(relative(poses[first], poses[last]), relative(truth[first], truth[last]))
    free = np.cumsum(~mask)
    return Drive(metres, mask[first] & (free[first] == free[last]),
                 np.array([step.status is Status.OK for step in steps]), mask)


def judged(file, drives) -> dict:
    """Return the figures of a lidar with its `file`, over all drives.

    ``rpe_1m_m``: mean error over 1 m with the file; ``defaults_m``: with the defaults; ``ratio_defaults``: the first by
    the second; ``equal_count``: drives on which the file and the defaults give the same; ``worse_count``: drives on
    which the file is worse by more than a fifth; ``ok``: fraction of the scans that are `OK`.

    Where the true surfaces constrain the motion: ``constrained``: fraction of these scans; ``certain_m``: mean error
    with the file; ``best_m``: with the best of all files; ``ratio_best``: the first by the second; ``ok_constrained``:
    fraction of these scans that are `OK`.
    """
    mean, certain = {}, {}
    for name in drives[0]:
        metres, mask = (np.concatenate(each) for each in zip(*(drive[name][:2] for drive in drives), strict=True))
        mean[name], certain[name] = float(metres.mean()), float(metres[mask].mean()) if mask.any() else math.nan
    best = min(certain[name] for name in certain if name != DEFAULTS)
    single = Counter(_compared(drive[file].metres.mean(), drive[DEFAULTS].metres.mean()) for drive in drives)
    ok, mask = (np.concatenate(each) for each in zip(*(drive[file][2:] for drive in drives), strict=True))
    return {'rpe_1m_m': mean[file], 'defaults_m': mean[DEFAULTS], 'ratio_defaults': mean[file] / mean[DEFAULTS],
            'drives_count': len(drives), 'equal_count': single['equal'], 'worse_count': single['worse'],
            'ok': float(ok.mean()), 'constrained': float(mask.mean()), 'certain_m': certain[file], 'best_m': best,
            'ratio_best': certain[file] / best, 'ok_constrained': float(ok[mask].mean()) if mask.any() else math.nan}


def _compared(error, other):
    return 'equal' if error == other else 'worse' if error > 1.2 * other else 'better or similar'
