"""Do the covariances tell the truth? Registrations in simulated worlds, where the error is known exactly."""
import dataclasses
import math

import numpy as np

from ..core.records import Status
from ..core.se2 import SE2
from ..simulation import LIDARS, Lidar, corridor, follow, hall, rooms
from ..simulation import measure as view
from ..simulation.worlds import clearance
from .bounds import Bound
from .methods import method
from .report import Report

REGISTRATIONS = 1000
WORLDS = {'rooms': rooms, 'corridors': corridor, 'halls': hall}
SEEDS = 5
SENSORS = {'plain': Lidar(), **{name: dataclasses.replace(LIDARS[name], duration=0.0)
                                for name in ('lms200', 'utm30lx', 'rplidar_a2')}}
TRANSLATION, ROTATION = 0.4, 0.3
"""Largest motion between the two scans along each axis [m] and turn [rad]."""
MARGIN = 0.2
LIMIT = 7.815
"""95 % of the squared errors, in units of their covariance, are below this with three degrees of freedom."""
WITHIN = Bound(0.90, 0.98)


def views(world, lidar, rng):
    """Two scans near the tour of a world and the true motion between them."""
    path = follow(world.tour)
    while True:
        x, y, _ = path.poses_at(rng.uniform(0.0, path.duration, 1))[0]
        first = SE2(x, y, rng.uniform(-math.pi, math.pi))
        truth = SE2(*rng.uniform(-TRANSLATION, TRANSLATION, 2), rng.uniform(-ROTATION, ROTATION))
        poses = [first.as_array(), (first @ truth).as_array()]
        if clearance(np.array(poses)[:, :2], world.segments, world.circles).min() > MARGIN:
            return *(view(world, [pose], lidar, rng) for pose in poses), truth


def judged(registration, truth):
    """(3,) error in the current sensor's frame [m, m, rad] and its covariance (3, 3); None for a failure."""
    if registration.status is Status.FAILED:
        return None
    return (truth.inverse() @ registration.transform).as_array(), registration.covariance


def calibration(results) -> dict:
    """How errors and covariances agree.

    ``within``: share of the squared errors e' C^-1 e below 7.815, 95 % when the covariances are right; ``nees``: their
    median over 2.366, the median to be expected; ``x_spread``, ...: robust standard deviation of each error in units of
    its own sigma; ``counted``: share of the registrations that did not fail.
    """
    pairs = [result for result in results if result is not None]
    metrics = {'counted': len(pairs) / len(results)}
    if not pairs:
        return metrics
    errors, covariances = map(np.array, zip(*pairs, strict=True))
    squared = np.einsum('ni,ni->n', errors, np.linalg.solve(covariances, errors[..., None])[..., 0])
    metrics['within'] = float((squared < LIMIT).mean())
    metrics['nees'] = float(np.median(squared) / 2.366)
    normalised = np.abs(errors) / np.sqrt(np.einsum('nii->ni', covariances))
    for name, spread in zip('xyt', np.median(normalised, axis=0) / 0.6745, strict=True):
        metrics[f'{name}_spread'] = float(spread)
    return metrics


def measure(args) -> Report:
    """Each kind of world with its sensors in turn."""
    from tqdm import tqdm
    report = Report()
    ours = method('dbscan')
    for kind, make in WORLDS.items():
        rng = np.random.default_rng(0)
        worlds = [make(seed=seed) for seed in range(SEEDS)]
        results = {name: [] for name in SENSORS}
        names = list(SENSORS)
        for k in tqdm(range(args.limit or REGISTRATIONS), kind, unit=' registrations', leave=False, disable=None):
            reference, current, truth = views(worlds[k % SEEDS], SENSORS[names[k % len(names)]], rng)
            results[names[k % len(names)]].append(judged(ours(reference, current), truth))
        rows = {'dbscan': calibration([result for some in results.values() for result in some])}
        rows |= {f'dbscan, {name}': calibration(some) for name, some in results.items() if some}
        report.add(kind, rows, {'within': WITHIN}, prefix=f'{kind}_')
    return report
