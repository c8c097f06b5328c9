# SPDX-License-Identifier: Apache-2.0
"""Table 1 of the paper, measured: what overlap and structure do to ICP, IDC, ICL and to ours."""
import itertools
import math
from functools import partial

import numpy as np

from dbscan_reg_ros.simulation import World, rooms

from ..registration.relations import common_view
from ..registration.synthetic import random_motion
from ..trials import Trial, run, two_views
from .table3 import SICK

PAIRS = 50
SEEDS = 5
TRANSLATION, ROTATION = 1.5, 0.8
"""Largest translation along each axis [m] and rotation [rad] between the two scans."""
OVERLAPS = {'high': (0.85, 1.0), 'low': (0.3, 0.6)}
"""Overlap of the views, from and to."""
AREA, COLUMNS = 20.0, 90


def columns(seed=0) -> World:
    """Round columns of all sizes strewn over a square, and nothing straight."""
    rng = np.random.default_rng(seed)
    centres = rng.uniform(0.0, AREA, (COLUMNS, 2))
    near, far = 0.3 * AREA, 0.7 * AREA
    tour = np.array([(near, near), (far, near), (far, far), (near, far), (near, near)])
    return World(np.empty((0, 2, 2)), tour, np.column_stack((centres, rng.uniform(0.1, 0.6, COLUMNS))))


WORLDS = {'structured': rooms, 'unstructured': columns}


def trials(limit=None) -> list:
    """Return a `Trial` for each kind of world, overlap and number."""
    items = []
    for (kind, make), overlap in itertools.product(WORLDS.items(), OVERLAPS):
        rng = np.random.default_rng(0)
        worlds = [make(seed) for seed in range(SEEDS)]
        items += [trial(f'{kind}_{overlap}', str(k), worlds[k % SEEDS], *OVERLAPS[overlap], rng)
                  for k in range(limit or PAIRS)]
    return items


def trial(group, label, world, low, high, rng) -> Trial:
    """Two scans that share between `low` and `high` of their view."""
    motion = partial(random_motion, translation=TRANSLATION, rotation=ROTATION)
    while True:
        drawn = Trial(group, label, *two_views(world, SICK['180'], rng, motion))
        if low <= common_view(drawn) <= high:
            return drawn


def add(report, methods, limit=None):
    """Add the table: for each group the success rate and the median errors of all its trials."""
    rows = {name: summarise(outcomes) for name, outcomes in run(methods, trials(limit), 'table 1').items()}
    report.add('table 1', rows, {}, prefix='table1_')


def summarise(outcomes) -> dict:
    """Group -> success rate; then the median errors of the group."""
    metrics = {}
    for group, items in itertools.groupby(outcomes, lambda outcome: outcome.trial.group):
        some = list(items)
        metrics[group] = float(np.mean([outcome.success for outcome in some]))
        metrics[f'{group}_median_m'] = float(np.median([outcome.translation_error for outcome in some]))
        metrics[f'{group}_median_deg'] = math.degrees(np.median([outcome.rotation_error for outcome in some]))
    return metrics
