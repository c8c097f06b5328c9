# SPDX-License-Identifier: Apache-2.0
"""Consistency of the covariances: registrations in simulated worlds, where the error is known exactly.

Filters and graphs weigh poses by their covariance: 95 % of the errors have to lie inside the ellipsoid of 95 %, not
fewer, and not nearly all.
"""
import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np

from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.methods import method
from dbscan_reg_ros.simulation import LIDARS, Lidar, corridor, hall, rooms

from ..report import Bound, Report
from ..trials import two_views
from .synthetic import random_motion

REGISTRATIONS = 1000
WORLDS: dict[str, Callable] = {'rooms': rooms, 'corridors': corridor, 'halls': hall}
SEEDS = 5
SENSORS = {'plain': Lidar(), **{name: dataclasses.replace(LIDARS[name], duration=0.0)
                                for name in ('sick_lms200', 'hokuyo_utm30lx', 'rplidar_a')}}
TRANSLATION, ROTATION = 0.4, 0.3
"""Largest translation along each axis [m] and rotation [rad] between the two scans."""
LIMIT = 7.815
"""95 % of the squared errors, in units of their covariance, are below this with three degrees of freedom."""
WITHIN = Bound(0.90, 0.98)


def judged(registration, truth):
    """(3,) error in the current sensor's frame [m, m, rad] and its covariance (3, 3); None for a failure."""
    if registration.status is Status.FAILED:
        return None
    return (truth.inverse() @ registration.transform).as_array(), registration.covariance


def calibration(results) -> dict:
    """How errors and covariances agree.

    ``within``: fraction of the squared errors e' C^-1 e below 7.815, 95 % when the covariances are right; ``nees``:
    their median over 2.366, the median to be expected; ``x_spread``, ...: robust standard deviation of each error in
    units of its own sigma; ``counted``: fraction of the registrations that did not fail.
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
    motion = partial(random_motion, translation=TRANSLATION, rotation=ROTATION)
    for kind, make in WORLDS.items():
        rng = np.random.default_rng(0)
        worlds = [make(seed=seed) for seed in range(SEEDS)]
        results = {name: [] for name in SENSORS}
        names = list(SENSORS)
        for k in tqdm(range(args.limit or REGISTRATIONS), kind, unit=' registrations', leave=False, disable=None):
            reference, current, truth = two_views(worlds[k % SEEDS], SENSORS[names[k % len(names)]], rng, motion)
            results[names[k % len(names)]].append(judged(ours(reference, current), truth))
        rows = {'dbscan': calibration([result for some in results.values() for result in some])}
        rows |= {f'dbscan, {name}': calibration(some) for name, some in results.items() if some}
        report.add(kind, rows, {'within': WITHIN}, prefix=f'{kind}_')
    return report
