# SPDX-License-Identifier: Apache-2.0
"""Twenty correct pairs of lidars at different heights, among people: whether one is accused, and the errors.

Walls, columns and furniture are seen by both lidars of a pair. Besides, the lower one sees the legs of tables, the
plinths of cabinets and what lies on the floor, the higher one the cabinets and what is on the tables; of people the
lower one sees the feet, the higher one the body.
"""
import dataclasses
import itertools
import math

import numpy as np

from dbscan_reg_ros.commands.workers import workers
from dbscan_reg_ros.core.geometry.se2 import as_vectors
from dbscan_reg_ros.core.sensor import Sensor
from dbscan_reg_ros.evaluation.metrics import evaluate
from dbscan_reg_ros.simulation import PRESETS, Lidar, Path, Person, corridor, follow, hall, rooms, simulate
from dbscan_reg_ros.simulation.worlds import box, clearance

from ..odometry.course import Course
from ..odometry.courses import FRONT, REAR
from ..odometry.drift import OURS, SeveralLidars
from ..odometry.drift import follow as tracked
from ..report import at_most
from .several import Watched

WORLDS = {'rooms': rooms, 'corridor': corridor, 'hall': hall}
PAIRS = 20
EACH_SEED = 4
"""Pairs for each of ``--seeds``, by default all."""
SECONDS = 45.0
CLEAR = 0.5
"""Objects keep this distance [m] from the path."""
PLINTH = 0.05
"""The plinth of a cabinet is set back by this distance [m] on each side."""
OBJECTS, PEOPLE = 24, 4
ASIDE = 0.9
"""Distance [m] of people from the tour: they do not walk through the robot."""
PACE = 1.0, 1.5
"""Speeds of people [m/s], faster than the robot: the course ``companions`` has those who walk along."""
FEET, BODY = 0.1, 0.18
"""Radii of what the lower and the higher lidar see of a person [m]."""
SCANNER = Lidar(541, math.radians(-135.0), math.radians(0.5), 0.05, 30.0, 12.5, duration=0.06, noise=0.01,
                resolution=0.01)
LIDARS = ((SCANNER, dataclasses.replace(SCANNER, rate=15.0, duration=0.05)),
          (PRESETS['rplidar_s'], PRESETS['rplidar_s']))
"""Models of a pair, in turns."""
SPARSE = 3, 8
"""One scan of so many is kept at random for drives at 2 Hz with gaps, least number and the first that is too large."""
BOUNDS = {'accused_count': at_most(0), 'accused_sparse_count': at_most(0), 'ratio_better': at_most(1.0)}


def add_table(report, args):
    """Add a table of each pair alone and together to a `Report`; a row for each world and one for all."""
    pairs = range(min(PAIRS, EACH_SEED * args.seeds))
    with workers(args.processes) as executor:
        found = list(executor.map(judged, pairs, itertools.repeat(args.limit)))
    rows = {world: _summary([each for each in found if each['world'] == world]) for world in WORLDS
            if any(each['world'] == world for each in found)}
    rows['all'] = _summary(found)
    report.add_courses('heights', rows, OURS, {'all': BOUNDS})
    if args.verbose:
        report.tables += [f'pair {each["pair"]} ({each["world"]}), {name}: {each[name]}'
                          for name in ('accusation', 'sparse') for each in found if each[name]]


def judged(pair, limit=None) -> dict:
    """Errors of both lidars of a pair over 5 m, alone and together, and whether the second was accused."""
    world, *courses = drive(pair)
    course, other = (each.take(slice(limit)) for each in courses)
    comparisons, sparse = Watched(), Watched()
    both = tracked(SeveralLidars(course.others, comparisons), course, 'both')
    few = thinned(course, pair)
    tracked(SeveralLidars(few.others, sparse), few, 'sparse')
    alone = [_error(each, tracked(SeveralLidars(()), each, 'alone'))
             for each in (dataclasses.replace(course, others=()), other)]
    return {'pair': pair, 'world': world, 'first_m': alone[0], 'second_m': alone[1], 'both_m': _error(course, both),
            'accusation': comparisons.text, 'sparse': sparse.text, 'unused': comparisons.unused}


def _error(course, run) -> float:
    """Mean error over 5 m [m]."""
    return evaluate(run.poses, course.stamps, None, course.reference).get('rpe_5m_mean_m', math.nan)


def _summary(found) -> dict:
    """Means over pairs; ``ratio_better`` is the mean error of both lidars to that of the better one alone."""
    means = {name: float(np.mean([each[name] for each in found])) for name in ('first_m', 'second_m', 'both_m')}
    better = float(np.mean([min(each['first_m'], each['second_m']) for each in found]))
    return {'pairs_count': len(found), **means, 'better_m': better, 'ratio_better': means['both_m'] / better,
            'accused_count': sum(bool(each['accusation']) for each in found),
            'accused_sparse_count': sum(bool(each['sparse']) for each in found),
            'unused': float(np.mean([each['unused'] for each in found]))}


def drive(pair) -> tuple:
    """Return the name of the world, and the courses of both lidars and of the second alone."""
    name = list(WORLDS)[pair % len(WORLDS)]
    lower_first = bool(pair // len(WORLDS) % 2)
    world = WORLDS[name](seed=pair)
    path = follow(np.vstack((world.tour, world.tour[-2::-1])))
    path = Path(path.times[path.times < SECONDS], path.poses[path.times < SECONDS])
    rng = np.random.default_rng(pair)
    world = dataclasses.replace(world, people=tuple(walker(world.tour, rng) for _ in range(PEOPLE)))
    lower, higher = at_two_heights(world, path.poses[::5, :2], rng)
    seen = (lower, higher) if lower_first else (higher, lower)
    models = LIDARS[pair // (2 * len(WORLDS)) % len(LIDARS)]
    first, second = (simulate(each, path, dataclasses.replace(model, mounting=mounting, phase=phase), pair + 100 * k)
                     for k, (each, model, mounting, phase)
                     in enumerate(zip(seen, models, (FRONT, REAR), (0.0, 0.019), strict=True)))
    sensor = Sensor('second', FRONT.inverse() @ REAR, rank=1)
    return (name, Course(first.scans, reference=first.truth, others=((sensor, second.scans),)),
            Course(second.scans, reference=second.truth))


def thinned(course, seed) -> Course:
    """Return the course with few of the scans of each lidar, chosen at random: 2 Hz, with gaps of up to 0.7 s."""
    rng = np.random.default_rng(seed)

    def few(scans):
        numbers = np.cumsum(rng.integers(*SPARSE, len(scans)))
        return numbers[numbers < len(scans)]
    kept = few(course.scans)
    others = tuple((sensor, [scans[k] for k in few(scans)]) for sensor, scans in course.others)
    return Course([course.scans[k] for k in kept], reference=course.reference[kept], others=others)


def walker(tour, rng) -> Person:
    """Return a person walking to and fro along one leg of the `tour`, beside the robot if they meet."""
    leg = rng.integers(len(tour) - 1)
    start, end = tour[leg:leg + 2]
    along = (end - start) / max(math.dist(start, end), 1e-9)
    aside = rng.choice((-1.0, 1.0)) * ASIDE * np.array((-along[1], along[0]))
    return Person(np.array([start, end]) + aside, rng.uniform(*PACE), BODY)


def at_two_heights(world, way, rng) -> tuple:
    """Return the world as the lower and as the higher lidar see it."""
    corners = world.segments.reshape(-1, 2)
    low, high = corners.min(axis=0), corners.max(axis=0)
    boxes, legs = ([], []), []
    for kind in itertools.islice(itertools.cycle(('table', 'cabinet', 'on the floor', 'on a table')), OBJECTS):
        (x, y), angle = rng.uniform(low, high), rng.uniform(0.0, math.pi)
        length, width = rng.uniform(0.6, 1.6), rng.uniform(0.4, 0.8)
        if clearance(way, box(x, y, length, width, angle), np.empty((0, 3))).min() < CLEAR:
            continue
        if kind == 'table':
            feet = np.array((1 + 1j, -1 + 1j, -1 - 1j, 1 - 1j)) * 0.5
            feet = (feet.real * length + 1j * feet.imag * width) * np.exp(1j * angle) + complex(x, y)
            legs += [(*foot, 0.025) for foot in as_vectors(feet)]
        if kind in ('cabinet', 'on a table'):
            boxes[1].append(box(x, y, length, width, angle))
        if kind in ('cabinet', 'on the floor'):
            back = 2.0 * PLINTH if kind == 'cabinet' else 0.0
            boxes[0].append(box(x, y, length - back, width - back, angle))
    lower, higher = (dataclasses.replace(world, segments=np.concatenate((world.segments, *each))) for each in boxes)
    feet = tuple(dataclasses.replace(person, radius=FEET) for person in world.people)
    circles = np.vstack((world.circles, np.array(legs).reshape(-1, 3)))
    return dataclasses.replace(lower, circles=circles, people=feet), higher
