# SPDX-License-Identifier: Apache-2.0
"""Registration without a prior for any motion, by the overlap of the views.

Success rate, and precision and recall of `OK`.

There is no bound: the table says from which overlap on a registration can be expected.
"""
import dataclasses
import itertools
import math
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dbscan_reg_ros.commands.workers import workers
from dbscan_reg_ros.core.errors import DbscanRegError
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.methods import method
from dbscan_reg_ros.simulation import LIDARS, World, corridor, hall, rooms, with_people
from dbscan_reg_ros.simulation.worlds import box, clearance

from ..report import Report
from ..trials import Trial, attempt, two_views

LIDARS_BY_VIEW = {'180': 'sick_lms200', '270': 'hokuyo_utm30lx', '360': 'rplidar_a'}
NOISES = {'low': 1.0, 'high': 3.0}
"""Times that of the lidar's data sheet."""
KINDS: dict[str, Callable] = {'corridors': corridor, 'halls': hall, 'rooms': rooms}
WORLDS = (*KINDS, *(f'busy_{kind}' for kind in KINDS))
SEEDS = 5
"""Worlds of each kind."""
EDGES = (0.0, 0.3, 0.5, 0.7, 1.0)
CLASSES = ('0_30', '30_50', '50_70', '70_100')
"""Overlap of the views [%]."""
SLACK = 0.3
"""A return counts as within what the reference saw when it is no farther than this [m] behind it."""
DRAWS = 12
"""So many pairs are drawn at most for each one that is wanted of a class: with small motions few share little."""
PEOPLE, CLUTTER, BOXES, CLEAR = 4, 30, 0.5, 0.4
"""Of a busy world: people, small objects tried, the ratio of boxes, and how far [m] they stay from the tour."""
APART = 5.0
"""Longest time between two views [s], in which people walk."""
METHODS = ('dbscan', 'small_gicp')


@dataclass(frozen=True)
class Cell:
    """What pairs are drawn of: names from the tables above; `lidar` may be any of `simulation.LIDARS` as well."""

    lidar: str
    world: str
    motion: str
    noise: str

    def __str__(self):
        return f'{self.lidar}_{self.world}_{self.motion}_{self.noise}'


def any_motion(rng) -> SE2:
    """Return a motion with x within 5 m, y within 2 m and any rotation."""
    return SE2(rng.uniform(-5.0, 5.0), rng.uniform(-2.0, 2.0), rng.uniform(-math.pi, math.pi))


def near_motion(rng) -> SE2:
    """Return a motion with x and y within 1.5 m and a rotation within 0.6 rad."""
    return SE2(rng.uniform(-1.5, 1.5), rng.uniform(-1.5, 1.5), rng.uniform(-0.6, 0.6))


MOTIONS = {'any': any_motion, 'near': near_motion}


def sensor(cell):
    """Return the lidar of a `Cell`, all of whose beams are measured at once."""
    lidar, factor = LIDARS[LIDARS_BY_VIEW.get(cell.lidar, cell.lidar)], NOISES[cell.noise]
    return dataclasses.replace(lidar, duration=0.0, noise=factor * lidar.noise, noise_ratio=factor * lidar.noise_ratio)


def worlds(name, seed=0) -> list:
    """Return the worlds of one of `WORLDS`; a busy one is another world of its kind, with people and clutter.

    Another `seed` gives other worlds.
    """
    kind, first = name.removeprefix('busy_'), 2 * SEEDS * seed
    if name == kind:
        return [KINDS[kind](seed=each) for each in range(first, first + SEEDS)]
    return [with_people(cluttered(KINDS[kind](seed=each), each), PEOPLE, each)
            for each in range(first + SEEDS, first + 2 * SEEDS)]


def cluttered(world, seed) -> World:
    """Return the world with small boxes and poles that keep clear of its tour."""
    rng = np.random.default_rng(seed)
    way = np.concatenate([np.linspace(a, b, 50) for a, b in itertools.pairwise(world.tour)])
    low, high = world.segments.min(axis=(0, 1)), world.segments.max(axis=(0, 1))
    boxes, poles, none = [], [], np.empty((0, 3))
    for x, y in rng.uniform(low, high, (CLUTTER, 2)):
        part = box(x, y, rng.uniform(0.15, 0.6), rng.uniform(0.15, 0.5), rng.uniform(0.0, math.pi))
        post = np.array([(x, y, rng.uniform(0.03, 0.15))])
        if rng.random() < BOXES and clearance(way, part, none).min() > CLEAR:
            boxes.append(part)
        elif clearance(way, np.empty((0, 2, 2)), post).min() > CLEAR:
            poles.append(post)
    return dataclasses.replace(world, segments=np.concatenate([world.segments, *boxes]),
                               circles=np.concatenate([world.circles, *poles]))


def shared_view(reference, current, truth) -> float:
    """Return the fraction of the current returns that lie, by the truth, within the view of the reference.

    A point lies within it when it is in the field of view and, up to a tolerance, no farther than the reference's
    range at the nearest beam, or than its range_max where that beam has no return.
    """
    geometry = reference.geometry
    points = truth.apply(current.points[current.valid])
    beam = (np.arctan2(points[:, 1], points[:, 0]) - geometry.angle_min) / geometry.angle_increment
    turn = 2.0 * math.pi / abs(geometry.angle_increment)
    beam = np.round((beam + 0.5) % turn - 0.5).astype(int)
    inside = beam < geometry.size
    seen = np.where(reference.valid, reference.ranges.astype(float), geometry.range_max)[np.where(inside, beam, 0)]
    return float((inside & (np.hypot(points[:, 0], points[:, 1]) <= seen + SLACK)).mean()) if len(points) else 0.0


def pairs(cell, wanted, seed=0) -> list:
    """`Trial`s, at most `wanted` of each class, which is the group; other seeds draw others in other worlds."""
    rng, made, lidar = np.random.default_rng(seed), worlds(cell.world, seed), sensor(cell)
    found = {name: [] for name in CLASSES}
    for k in range(DRAWS * wanted):
        now = rng.uniform(0.0, 60.0)
        times = (now, now + rng.uniform(0.0, APART))
        reference, current, truth = two_views(made[k % len(made)], lidar, rng, MOTIONS[cell.motion], times)
        share = shared_view(reference, current, truth)
        name = CLASSES[min(int(np.searchsorted(EDGES, share, 'right')) - 1, len(CLASSES) - 1)]
        if len(found[name]) < wanted:
            found[name].append(Trial(name, str(cell), reference, current, truth))
        if all(len(some) == wanted for some in found.values()):
            break
    return [trial for some in found.values() for trial in some]


def outcomes(cell, wanted, names) -> dict:
    """Return method -> (N, 3) int: class, right, `OK` of each pair of a cell."""
    methods, trials = [method(name) for name in names], pairs(cell, wanted)
    rows = {each.name: np.empty((len(trials), 3), dtype=int) for each in methods}
    for k, trial in enumerate(trials):
        for each in methods:
            result = attempt(each, trial)
            rows[each.name][k] = CLASSES.index(trial.group), result.success, result.status is Status.OK
    return rows


def rates(rows) -> dict:
    """Metric -> number for each class.

    Pairs, the fraction right, how many `OK` and how many of these wrong, the fraction of the right ones called `OK`,
    and of all pairs those that are `OK` and wrong.
    """
    metrics = {}
    for k, name in enumerate(CLASSES):
        right, ok = rows[rows[:, 0] == k, 1:].T.astype(bool)
        if len(right):
            metrics |= {f'{name}_pairs_count': len(right), f'{name}_right': float(right.mean()),
                        f'{name}_ok_count': int(ok.sum()),
                        f'{name}_wrong_count': int((ok & ~right).sum()), f'{name}_silent': float((ok & ~right).mean()),
                        f'{name}_recall': float(ok[right].mean()) if right.any() else math.nan}
    right, ok = rows[:, 1:].T.astype(bool)
    return metrics | {'precision': float(right[ok].mean()) if ok.any() else math.nan,
                      'recall': float(ok[right].mean()) if right.any() else math.nan}


def measure(args) -> Report:
    """Every cell, several at a time."""
    from tqdm import tqdm

    names = available(args.method or METHODS)
    cells = [Cell(*words) for words in itertools.product(
        args.lidar or LIDARS_BY_VIEW, args.world or WORLDS, args.motion or MOTIONS, args.noise or NOISES)]
    report, wanted = Report(), args.limit or args.pairs
    with workers(args.processes) as executor:
        jobs = [executor.submit(outcomes, cell, wanted, names) for cell in cells]
        found = [job.result() for job in tqdm(jobs, 'overlap', unit=' cells', leave=False, disable=None)]
    for name in names:
        rows = {str(cell): rates(each[name]) for cell, each in zip(cells, found, strict=True)}
        rows['all'] = rates(np.concatenate([each[name] for each in found]))
        report.add_courses('overlap', rows, name)
    return report


def available(names) -> list:
    """Those methods that can run here; unless they are named, an absent peer is left out."""
    found = []
    for name in names:
        try:
            method(name)
            found.append(name)
        except DbscanRegError as missing:
            if names is not METHODS:
                raise
            print(f'left out: {missing}', file=sys.stderr)
    return found
