"""The Freiburg relations of the Intel log without an initial guess."""
import itertools
import math

import numpy as np
from scipy.spatial import cKDTree

from .bounds import at_least
from .trials import Trial, run, summarise, thinned

BOUNDS = {'relations_neighbour': at_least(0.99), 'relations_loop': at_least(0.985)}
NEIGHBOURS_WITHIN = 30.0
VIEWS = (0.0, 0.3, 0.5, 0.7, 1.0)


def trials(intel, limit=None) -> list:
    """A `Trial` for each relation; `limit` counts for neighbours and loop closures apart."""
    groups = {'relations_neighbour': [], 'relations_loop': []}
    for i, j, truth, seconds in intel.relations:
        group = 'relations_neighbour' if abs(seconds) < NEIGHBOURS_WITHIN else 'relations_loop'
        groups[group].append(Trial(group, f'{i} {j}', intel.scans[i], intel.scans[j], truth))
    return [trial for items in groups.values() for trial in thinned(items, limit)]


def common_view(trial) -> float:
    """The share of the returns, of the scan that shares less, that the other scan has at the true pose, 0..1.

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


def measure(intel, methods, limit=None):
    """Metrics by method, and the outcomes by method; ``view_30_50`` is the success where 30 to 50 % are shared."""
    items = trials(intel, limit)
    views = np.array([common_view(trial) for trial in items])
    outcomes = run(methods, items, 'relations')
    metrics = {}
    for name, results in outcomes.items():
        metrics[name] = summarise(results)
        success = np.array([outcome.success for outcome in results])
        for low, high in itertools.pairwise(VIEWS):
            inside = (views >= low) & ((views < high) | (high == 1.0))
            key = f'view_{round(100 * low)}_{round(100 * high)}'
            metrics[name][key] = float(success[inside].mean()) if inside.any() else math.nan
            metrics[name][f'{key}_count'] = int(inside.sum())
    return metrics, outcomes
