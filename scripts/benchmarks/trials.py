# SPDX-License-Identifier: Apache-2.0
"""Registrations with known truth: drawn, run, judged and summed up."""
import math
import time
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.core.scan import Scan
from dbscan_reg_ros.simulation import follow, measure
from dbscan_reg_ros.simulation.worlds import clearance

from .report import Report

TRANSLATION_LIMIT = 0.10
ROTATION_LIMIT = math.radians(2.0)


@dataclass(frozen=True, eq=False)
class Trial:
    """Two scans and the truth: the pose of `current` in the frame of `reference`."""

    group: str
    """The rate that it counts for, for example ``pairs_s5``."""
    label: str
    """Which one it is, for a human reader."""
    reference: Scan
    current: Scan
    truth: SE2


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a method made of a trial: errors [m], [rad] in the current sensor's frame and time [s]."""

    trial: Trial
    transform: SE2
    status: Status
    translation_error: float
    rotation_error: float
    seconds: float

    @property
    def success(self):
        """Within 0.10 m and 2 deg of the truth."""
        return self.translation_error <= TRANSLATION_LIMIT and self.rotation_error <= ROTATION_LIMIT


def attempt(method, trial) -> Outcome:
    """Run `method` on `trial`; the time is that of one scan's features and the registration."""
    reference = method.prepare(trial.reference)
    start = time.perf_counter()
    result = method.align(reference, method.prepare(trial.current))
    seconds = time.perf_counter() - start
    error = trial.truth.inverse() @ result.transform
    return Outcome(trial, result.transform, result.status, math.hypot(error.x, error.y), abs(error.theta), seconds)


def run(methods, trials, title) -> dict:
    """Return method name -> list of `Outcome`; the methods alternate on each trial, so that load affects all alike."""
    from tqdm import tqdm
    outcomes = {method.name: [] for method in methods}
    for method in methods:
        attempt(method, trials[0])
    for trial in tqdm(trials, desc=title, unit='trial', leave=False, disable=None):
        for method in methods:
            outcomes[method.name].append(attempt(method, trial))
    return outcomes


def rates(args, trials, bounds, more=None):
    """Return a `Report` on `trials` for the methods that `args` names; ``--verbose`` lists the failures.

    `more(outcomes)` adds metrics of its own.
    """
    from dbscan_reg_ros.evaluation.methods import chosen

    rows = {}
    for name, outcomes in run(chosen(args.method), trials, args.benchmark).items():
        rows[name] = summarise(outcomes) | (more(outcomes) if more else {})
        if args.verbose:
            print(f'{name}\n{failures(outcomes)}\n')
    report = Report()
    report.add(args.benchmark, rows, bounds)
    return report


def summarise(outcomes) -> dict:
    """Metric -> number: the success rate of each group, errors, precision and recall of the status ``OK``, times."""
    groups = dict.fromkeys(outcome.trial.group for outcome in outcomes)
    success = np.array([outcome.success for outcome in outcomes])
    ok = np.array([outcome.status is Status.OK for outcome in outcomes])
    metrics = {group: _mean([o.success for o in outcomes if o.trial.group == group]) for group in groups}
    metrics['median_m'] = _median([o.translation_error for o in outcomes if o.success])
    metrics['median_deg'] = math.degrees(_median([o.rotation_error for o in outcomes if o.success]))
    metrics['ok_precision'] = _mean(success[ok])
    metrics['ok_recall'] = _mean(ok[success])
    milliseconds = [1e3 * outcome.seconds for outcome in outcomes]
    metrics['ms_p50'], metrics['ms_p95'] = (float(q) for q in np.percentile(milliseconds, (50, 95)))
    return metrics


def failures(outcomes) -> str:
    """One line for each `Outcome` that failed, or was right and not called OK."""
    return '\n'.join(_line(outcome) for outcome in outcomes if not outcome.success or outcome.status.value != 'ok')


def _line(outcome: Outcome):
    trial, found = outcome.trial, outcome.transform
    return (f'{trial.group:20s} {trial.label:12s} {"right" if outcome.success else "WRONG"} {outcome.status.value:10s} '
            f'error {outcome.translation_error:.3f} m {math.degrees(outcome.rotation_error):7.2f} deg   '
            f'truth {_pose(trial.truth)} found {_pose(found)}')


def _pose(pose):
    return f'({pose.x:.3f}, {pose.y:.3f}, {pose.theta:.4f})'


def thinned(items, limit):
    """At most `limit` of `items`, evenly spread; all of them without a limit."""
    items = list(items)
    if limit is None or limit >= len(items):
        return items
    return [items[i] for i in np.linspace(0, len(items) - 1, limit).astype(int)]


def _mean(values):
    return float(np.mean(values)) if len(values) else math.nan


def _median(values):
    return float(np.median(values)) if len(values) else math.nan


MARGIN = 0.2
STEP = 0.1


@lru_cache(maxsize=16)
def path_along(world):
    """Return the path of a robot along the tour of a `World`."""
    return follow(world.tour)


def two_views(world, lidar, rng, motion, times=(0.0, 0.0)):
    """Two scans near the tour of a world, in any direction, and the true motion between them.

    Parameters
    ----------
    world : World
    lidar : Lidar
    rng : numpy.random.Generator
    motion : callable
        ``motion(rng)`` draws the motion, an `SE2`. It is drawn again, with the place, until the straight way between
        both places keeps 0.2 m clear of static objects, and the positions of people.
    times : (float, float)
        Of both views [s]: where people are.

    Returns
    -------
    reference, current : Scan
    truth : SE2
        Pose of the current sensor in the reference's frame.
    """
    path = path_along(world)
    while True:
        x, y, _ = path.poses_at(rng.uniform(0.0, path.duration, 1))[0]
        first = SE2(x, y, rng.uniform(-math.pi, math.pi))
        truth = motion(rng)
        poses = [first.as_array(), (first @ truth).as_array()]
        way = np.linspace(poses[0][:2], poses[1][:2], 2 + int(math.hypot(truth.x, truth.y) / STEP))
        free = all(clearance(pose[None, :2], world.segments, world.circles_at(time))[0] > MARGIN
                   for pose, time in zip(poses, times, strict=True))
        if free and clearance(way, world.segments, world.circles).min() > MARGIN:
            return *(measure(world, [pose], lidar, rng, time=time) for pose,
                     time in zip(poses, times, strict=True)), truth
