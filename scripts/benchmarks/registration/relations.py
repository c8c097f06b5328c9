# SPDX-License-Identifier: Apache-2.0
"""The Freiburg relations of the Intel log without an initial guess.

The relations are the public benchmark of the log, made by hand. What other scan matchers need a guess for has to be
found without one in all but the pairs that hardly overlap.
"""
import itertools
import math

import numpy as np
from scipy.spatial import cKDTree

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.evaluation.metrics import NEIGHBOURS_WITHIN

from ..intel import Intel
from ..report import at_least
from ..trials import Trial, rates, thinned

BOUNDS = {'relations_neighbour': at_least(0.99), 'relations_loop': at_least(0.985)}
VIEWS = (0.0, 0.3, 0.5, 0.7, 1.0)


def trials(intel, limit=None) -> list:
    """Return a `Trial` for each relation; `limit` counts for neighbours and loop closures apart."""
    groups = {'relations_neighbour': [], 'relations_loop': []}
    for (first, second), motion in zip(intel.relations.stamps, intel.relations.motions, strict=True):
        group = 'relations_neighbour' if abs(second - first) < NEIGHBOURS_WITHIN else 'relations_loop'
        i, j = intel.index(first), intel.index(second)
        groups[group].append(Trial(group, f'{i} {j}', intel.scans[i], intel.scans[j], SE2.from_array(motion)))
    return [trial for items in groups.values() for trial in thinned(items, limit)]


def common_view(trial) -> float:
    """Return the fraction of returns that the other scan has too at the true pose, 0..1.

    It is the smaller one of both scans.

    A return is shared when the other scan has one within 0.2 m, or within two beam spacings far away.
    """
    reference, current = (scan.points[scan.valid] for scan in (trial.reference, trial.current))
    moved = trial.truth.apply(current)
    spacing = 2.0 * abs(trial.current.geometry.angle_increment)
    shares = []
    for points, others, origin in ((moved, reference, (trial.truth.x, trial.truth.y)), (reference, moved, (0.0, 0.0))):
        reach = np.maximum(0.2, spacing * np.hypot(*(points - origin).T))
        shares.append((cKDTree(others).query(points)[0] < reach).mean())
    return float(min(shares))


def by_view(outcomes) -> dict:
    """Success by the overlap of the views: ``view_30_50`` from 30 to 50 %, and how many pairs they are."""
    views = np.array([common_view(outcome.trial) for outcome in outcomes])
    success = np.array([outcome.success for outcome in outcomes])
    metrics = {}
    for low, high in itertools.pairwise(VIEWS):
        inside = (views >= low) & ((views < high) | (high == 1.0))
        key = f'view_{round(100 * low)}_{round(100 * high)}'
        metrics[key] = float(success[inside].mean()) if inside.any() else math.nan
        metrics[f'{key}_count'] = int(inside.sum())
    return metrics


def measure(args):
    """Return a `Report`."""
    return rates(args, trials(Intel.below(args.data), args.limit), BOUNDS, by_view)
