# SPDX-License-Identifier: Apache-2.0
"""Odometry of recordings and simulated worlds, with the measures of the public benchmarks."""
import inspect
import time
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from dbscan_reg_ros.commands.workers import workers
from dbscan_reg_ros.core.errors import ScanError
from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.methods import BenchmarkError
from dbscan_reg_ros.evaluation.metrics import evaluate, path_lengths
from dbscan_reg_ros.evaluation.trackers import PRIORS, Ours, tracker
from dbscan_reg_ros.recordings import data_folder, write_csv
from dbscan_reg_ros.recordings.poses import relative
from dbscan_reg_ros.robot.scan_buffer import RecordedScans

from ..report import Report
from .bounds import DRIFT, HARDER, no_worse
from .course import Course, noised, scatter
from .courses import COURSES

METHODS = ('dbscan', 'small_gicp', 'kiss-icp', 'identity')
OURS = 'dbscan'
LASER_ONLY = 'dbscan, laser only'
PART = 500
"""Scans whose median time is compared."""
NAMED_WITHIN = np.radians(10.0)

SHOWN = (
    'relations_neighbour_mean_m', 'relations_neighbour_mean_deg', 'relations_all_mean_m', 'relations_all_std_m',
    'relations_all_mean_deg', 'rpe_1m_mean_m', 'rpe_1m_median_m', 'rpe_5m_mean_m', 'rpe_5m_median_m',
    'rpe_5m_mean_deg', 'step_p95_m', 'ate_m', 'frozen', 'driven_off_m', 'drift_m', 'drift_deg', 'named', 'across_m',
    'ok', 'disturbed_ok', 'within', 'ms_p50', 'ms_p99', 'ms_growth')
"""What the tables hold; the JSON file has every measure."""


@dataclass(eq=False)
class Drive:
    """What a tracker made of a course: a `Step` and the time [ms] for each scan."""

    course: Course
    steps: list = field(default_factory=list)
    milliseconds: list = field(default_factory=list)

    @property
    def poses(self):
        """``(N, 3)`` poses (x, y, theta) [m, m, rad]."""
        return np.array([(step.pose.x, step.pose.y, step.pose.theta) for step in self.steps])

    def write(self, path):
        """Return the poses that count, as ``index,x,y,theta,ms``."""
        judged = self.course.judged
        write_csv(path, self.poses[judged], self.course.indices[judged], np.array(self.milliseconds)[judged])


def drive(name, course, title, prior='none') -> Drive:
    """Run a new tracker over a course; `prior` names the source of the external prior, one of `PRIORS`."""
    if not course.others:
        return follow(tracker(name), course, title, prior)
    if name != OURS or prior != 'none':
        raise BenchmarkError(f'{title}: several lidars take no other method than {OURS}, and no prior')
    return follow(SeveralLidars(course.others), course, title)


class SeveralLidars(Ours):
    """The package's own `Odometry` with the scans of the `others` of a `Course` besides, compared by `comparisons`."""

    def __init__(self, others, comparisons=None):
        super().__init__(Parameters(), comparisons)
        self._sensors = [sensor for sensor, _ in others]
        self._scans = RecordedScans(scans for _, scans in others)
        self._begun = False

    def process(self, scan, external=None):
        """Process the older scans of the other lidars, then a `scan` of the first; return the step of the latter."""
        for other in self._scans.before(scan.stamp):
            if self._begun:
                with suppress(ScanError):
                    self._odometry.process(other.scan, None, self._sensors[other.lidar])
        self._begun = True
        return super().process(scan, external)


def follow(track, course, title, prior='none') -> Drive:
    """Run a tracker over a course; `prior` names the source of the external prior, one of `PRIORS`."""
    from tqdm import tqdm
    result = Drive(course)
    scans = tqdm(course.scans, title, unit=' scans', leave=False, disable=None)
    for scan, told in zip(scans, PRIORS[prior](course), strict=True):
        begin = time.perf_counter()
        result.steps.append(track.process(scan, told))
        result.milliseconds.append(1e3 * (time.perf_counter() - begin))
    return result


def judge(drive) -> dict:
    """Metric -> number: those of `recordings.metrics.evaluate`, times, and the fraction of scans called OK.

    ``driven_off_m``: the error of the length of the path. Of a stationary sensor ``drift_m`` and ``drift_deg``, the
    farthest that it strays. Where one direction is unobservable, ``named``: the fraction of scans that name it within
    10 deg, and ``across_m``: the largest error across it over 1 m. Of scans that only disturb ``disturbed_ok``: the
    fraction called OK. Of methods with covariances ``within``: the fraction of the scans whose pose is off, along x
    and y and in heading, by less than three of the published standard deviations.
    """
    course, judged, poses = drive.course, drive.course.judged, drive.poses
    reference = course.reference[judged]
    metrics = evaluate(poses[judged], course.stamps[judged], course.relations, reference)
    ok = np.array([step.status is Status.OK for step in drive.steps])
    metrics['ok'] = float(ok[judged].mean())
    metrics['driven_off_m'] = abs(float(path_lengths(poses[judged])[-1] - path_lengths(reference)[-1]))
    if not judged.all():
        metrics['disturbed_ok'] = float(ok[~judged].mean())
    if path_lengths(reference)[-1] == 0.0:
        metrics['drift_m'] = float(np.hypot(*poses[:, :2].T).max())
        metrics['drift_deg'] = float(np.degrees(np.abs(poses[:, 2])).max())
    if course.axis is not None:
        metrics |= _free_direction(drive)
    if all(step.covariance is not None for step in drive.steps):
        metrics['within'] = pose_within(drive)
    return metrics | _times(np.array(drive.milliseconds))


def _free_direction(drive):
    course, poses, reference = drive.course, drive.poses, drive.course.reference
    axis = course.axis - reference[0, 2]
    named = [step.degenerate_direction is not None
             and abs(wrap(2.0 * (step.degenerate_direction - axis))) < 2.0 * NAMED_WITHIN
             for step in drive.steps[1:]]
    path = path_lengths(reference)
    later = np.searchsorted(path, path + 1.0)
    first = np.flatnonzero(later < len(path))
    error = (relative(poses[first], poses[later[first]]) - relative(reference[first], reference[later[first]]))[:, :2]
    sideways = course.axis - reference[first, 2] + 0.5 * np.pi
    across = np.abs(error[:, 0] * np.cos(sideways) + error[:, 1] * np.sin(sideways))
    return {'named': float(np.mean(named)), 'across_m': float(across.max(initial=0.0))}


def pose_within(drive) -> float:
    """Return the fraction of the judged scans whose pose errors are all below three standard deviations."""
    judged, reference = drive.course.judged, drive.course.reference
    error = drive.poses - relative(reference[:1], reference)
    error[:, 2] = wrap(error[:, 2])
    variance = np.array([np.diagonal(step.covariance) for step in drive.steps])
    return float((error ** 2 < 9.0 * variance).all(axis=1)[judged].mean())


def _times(milliseconds):
    """``ms_p50``, ``ms_p95``, ``ms_p99`` and ``ms_growth``: the last 500 scans' median over that of 500 to 1000."""
    times = {f'ms_p{q}': float(np.percentile(milliseconds[1:], q)) for q in (50, 95, 99)}
    if len(milliseconds) >= 3 * PART:
        times['ms_growth'] = float(np.median(milliseconds[-PART:]) / np.median(milliseconds[PART:2 * PART]))
    return times


def measure(args) -> Report:
    """Every course by every method, side by side."""
    if args.limit == 1:
        raise BenchmarkError('--limit 1: a drive of one scan has no motion; expected 2 or more')
    report = Report()
    for name in args.course or COURSES:
        courses = chosen(name, args)
        rows, methods = {}, args.method or ((OURS,) if name in (*HARDER, 'scanners') else METHODS)
        if args.copies:
            report.add(f'{name}, {args.copies} copies', in_copies(courses, methods, args), {}, SHOWN,
                       prefix='' if name == 'intel' else f'{name}_')
            continue
        for method in methods:
            drives = [drive(method, course, f'{name} {method}', args.prior) for course in courses]
            rows[method] = mean_of([judge(result) for result in drives])
            if args.poses and method == OURS and name == (args.course or ['intel'])[0]:
                drives[0].write(args.poses)
        bounds = dict(DRIFT.get(name, {}))
        if args.prior == 'wheel' and OURS in rows and name == 'intel':
            rows[LASER_ONLY] = mean_of([judge(drive(OURS, course, f'{name} {LASER_ONLY}')) for course in courses])
            bounds |= no_worse(rows[LASER_ONLY])
        report.add(name, rows, bounds, SHOWN, prefix='' if name == 'intel' else f'{name}_')
    return report


def chosen(name, args, seeds=None) -> list:
    """Return the courses of a name: of ``--seeds`` or `seeds` where it takes any, and ``--limit`` scans of each."""
    if name not in COURSES:
        raise BenchmarkError(f'unknown course {name!r}; expected {", ".join(COURSES)}')
    make, seeds = COURSES[name], args.seeds or seeds
    if 'seeds' in inspect.signature(make).parameters:
        courses = make(seeds=range(seeds)) if seeds else make()
    else:
        courses = make(data_folder(args.data))
    return [course if args.limit is None else course.take(slice(args.limit)) for course in courses]


def in_copies(courses, methods, args) -> dict:
    """Means over noisy copies of the courses, and two standard errors of these, for each method."""
    rows = {}
    with workers(args.processes) as executor:
        for method in methods:
            jobs = [[executor.submit(judged_copy, method, course, seed, args.prior) for course in courses]
                    for seed in range(args.copies)]
            mean, spread = scatter([mean_of([job.result() for job in copy]) for copy in jobs])
            rows |= {method: mean, f'{method}, +-': spread}
    return rows


def judged_copy(method, course, seed, prior):
    """Return the result of `judge` for the copy of a course with noise of this `seed`."""
    return judge(drive(method, noised(course, seed), f'copy {seed}', prior))


def mean_of(rows):
    """Means of what all courses have; of lengths of paths and smooth corridors the worst."""
    shared = [name for name in rows[0] if all(name in row for row in rows)]
    worst = {'named': min, 'across_m': max, 'driven_off_m': max}
    return {name: float(worst.get(name, np.mean)([row[name] for row in rows])) for name in shared}
