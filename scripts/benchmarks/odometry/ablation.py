# SPDX-License-Identifier: Apache-2.0
"""Ablation: the odometry without one feature at a time, first on the courses that should need it, then on all.

Each result is kept in a folder, by commit, course and feature, so that an interrupted run continues.
"""
import hashlib
import json
import math
import subprocess
from pathlib import Path

from dbscan_reg_ros.commands.workers import workers
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.evaluation.methods import BenchmarkError
from dbscan_reg_ros.evaluation.trackers import Ours
from dbscan_reg_ros.recordings import data_folder

from ..report import Report
from .course import noised, scatter
from .courses import COURSES
from .drift import follow, judge, mean_of

FEATURES = {
    'ring band filter': ({'advanced.filter.test': 'off'}, ('far_noise', 'lidars')),
    'noise by range': ({'advanced.scan.noise_ratio_max': 0.0}, ('far_noise',)),
    'chains are clustered again': (
        {'advanced.rotation.max_width': 0.0}, ('sparse', 'outages')),
    'end points': ({'advanced.translation.end_weight': 0.0}, ('sparse', 'bursts')),
    'shortest translations': ({'advanced.translation.shortest_rotations': 0}, ('bursts', 'lidars')),
    'free space': ({'advanced.density.violation_weight': 0.0}, ('sparse', 'outages')),
    'wide search': ({'advanced.selection.wide_search_factor': 1}, ('sparse', 'outages')),
    'landmarks': ({'advanced.selection.max_landmarks': 0}, ('outages',)),
    'several candidates': ({'advanced.selection.top_candidates': 1}, ('sparse', 'bursts')),
    'search along a degenerate direction': (
        {'advanced.degeneracy.information_ratio': 0.0}, ('corridors', 'bursts')),
    'near-parallel walls in the alignment': (
        {'advanced.degeneracy.parallel_tolerance': 0.0}, ('featureless', 'lidars')),
    'near-parallel walls in the covariance': ({'advanced.decision.parallel_tolerance': 0.0}, ('leader', 'lidars')),
    'covariance of few points': ({'advanced.decision.few_points_scale': 0.0}, ('corridors', 'leader')),
    'gate after weak predictions': ({'advanced.decision.weak_prior_information': 0.0}, ('aces', 'sparse')),
    'score of the prediction': ({'advanced.prior.weight': 0.0}, ('bursts', 'corridors')),
    'motion model': ({'prior.source': 'none'}, ('corridors', 'trees')),
    'mean of three velocities': ({'advanced.prior.velocity_window': 1}, ('lidars', 'featureless')),
    'key-frame window': ({'odometry.reference': 'keyframe'}, ('rooms', 'corridors')),
    'local map of key frames': ({'odometry.key_frames': 1}, ('chairs', 'rooms')),
    'older key frames': ({'advanced.odometry.older_key_frames': 0}, ('sparse', 'losses')),
    'overlap of key frames': ({'advanced.odometry.key_frame_overlap': 0.0}, ('narrow', 'lidars')),
    'dynamic points': ({'advanced.odometry.dynamic_key_frames': 0}, ('leader', 'passers')),
    'movable objects': ({'advanced.odometry.movable_size': 0.0}, ('leader', 'passers')),
    'movable objects where they are all': (
        {'advanced.odometry.movable_information_ratio': 0.0}, ('chairs', 'trees')),
    'poles': ({'advanced.odometry.pole_size': 0.0}, ('chairs', 'trees')),
    'zero-velocity update': ({'advanced.odometry.zero_velocity_gate': 0.0}, ('lms511', 'spinup')),
    'deskewing': ({'odometry.deskew': False}, ('losses', 'bursts')),
    'Manhattan heading': ({'advanced.manhattan.heading_drift': 0.0}, ('intel', 'rooms')),
    'gross outliers': ({'advanced.filter.gross_error': 0.0}, ('sparse', 'corridors')),
    'breakpoints by the noise': ({'advanced.segments.breakpoint_noise': 0.0}, ('lidars', 'sparse')),
    'pre-selection': ({'advanced.selection.preselected': 10000}, ('sparse', 'corridors')),
    'score gap': ({'advanced.selection.max_score_gap': 2.0}, ('sparse', 'covered')),
    'key frames by angle': ({'advanced.odometry.key_frame_angle': 6.4}, ('sparse', 'narrow')),
}
"""Feature -> parameters that switch it off, and the courses that should be worse without it."""
LOWER = ('rpe_1m_mean_m', 'rpe_5m_mean_m', 'ate_m', 'across_m', 'drift_m', 'frozen')
HIGHER = ('ok', 'within', 'named')
MARGIN = 0.1
"""Ratio by which a measure must get worse, beyond the scatter of the copies."""
QUICK = {'limit': 150, 'drives': 1, 'copies': 2}


def measure(args) -> Report:
    """Every feature on its courses and, unless quick, on all others; what no course needs is listed last."""
    for kind, names, known in (('feature', args.feature, FEATURES), ('course', args.course, COURSES)):
        if unknown := set(names or ()) - set(known):
            raise BenchmarkError(f'unknown {kind} {min(unknown)!r}; expected {", ".join(map(repr, known))}')
    chosen = {name: FEATURES[name] for name in args.feature or FEATURES}
    runner, rows = Runner(args), {}
    for name, (_, courses) in chosen.items():
        rows |= runner.rows(name, args.course or courses)
    if not args.quick and not args.course:
        for name, (_, courses) in chosen.items():
            rows |= runner.rows(name, [course for course in COURSES if course not in courses])
    report = Report()
    report.metrics = {name: {'needed': float(row['needed']), **(
        {row['measure']: row['with'], f'without_{row["measure"]}': row['without']} if row['measure'] else {})}
        for name, row in rows.items()}
    report.tables.append('\n'.join(['| without | course | measure | with it | without it |', '|---|---|---|---|---|',
                                    *(line(row) for row in rows.values())]))
    idle = [name for name in chosen if not any(row['needed'] for row in rows.values() if row['feature'] == name)]
    report.tables.append('no course is worse without: ' + (', '.join(idle) or 'none'))
    return report


class Runner:
    """Runs courses with and without features; keeps the results below ``args.cache``."""

    def __init__(self, args):
        settings = QUICK if args.quick else {'limit': None, 'drives': None, 'copies': 4}
        self._limit = args.limit or settings['limit']
        self._drives, self._copies = settings['drives'], args.copies or settings['copies']
        self._processes = args.processes
        self._data, self._built = data_folder(args.data), {}
        self._folder = args.cache / source_id() / f'{self._limit or "all"}_{self._drives or "all"}_{self._copies}'

    def rows(self, feature, courses) -> dict:
        """``feature, course`` -> its row: the measure that gets worse most, with and without the feature."""
        found = {}
        for course in courses:
            plain, without = self._result(course, None), self._result(course, feature)
            found[f'{feature}, {course}'] = {'feature': feature, 'course': course, **worst(plain, without)}
        return found

    def _result(self, course, feature):
        path = self._folder / course / f'{(feature or "all features").replace(" ", "_")}.json'
        if not path.exists():
            values = self._run(course, FEATURES[feature][0] if feature else {})
            path.parent.mkdir(parents=True, exist_ok=True)
            part = path.with_suffix('.part')
            part.write_text(json.dumps(values))
            part.replace(path)
        return json.loads(path.read_text())

    def _courses(self, name):
        if name not in self._built:
            courses, first = COURSES[name](self._data)[:self._drives], slice(self._limit)
            self._built[name] = [course.take(first) for course in courses]
        return self._built[name]

    def _run(self, name, changes):
        """Return the means, and two standard errors of them, of the measures over noisy copies of a course."""
        courses = self._courses(name)
        with workers(self._processes) as executor:
            jobs = [[executor.submit(judged_copy, changes, course, seed) for course in courses]
                    for seed in range(self._copies)]
            return scatter([mean_of([job.result() for job in copy]) for copy in jobs])


def judged_copy(changes, course, seed):
    """Return the measures of the odometry with changed parameters on the copy of a course with noise of this `seed`."""
    return judge(follow(Ours(Parameters().replace(changes)), noised(course, seed), f'copy {seed}'))


def worst(plain, without) -> dict:
    """Return the measure that gets worse most: its values, two standard errors, and whether it is clearly worse."""
    (values, spread), (changed, changed_spread) = plain, without
    best = {'measure': '', 'needed': False, 'excess': -math.inf}
    for name in (*LOWER, *HIGHER):
        if name not in values or name not in changed or values[name] == changed[name]:
            continue
        loss = changed[name] - values[name] if name in LOWER else values[name] - changed[name]
        excess = loss - math.hypot(spread[name], changed_spread[name]) - MARGIN * abs(values[name])
        excess /= max(abs(values[name]), 1e-3)
        if excess > best['excess']:
            best = {'measure': name, 'with': values[name], 'with_spread': spread[name], 'without': changed[name],
                    'without_spread': changed_spread[name], 'excess': excess, 'needed': excess > 0.0}
    return best


def line(row) -> str:
    """Return the row of the table; bold where the course is clearly worse without the feature."""
    if not row['measure']:
        return f'| {row["feature"]} | {row["course"]} | all | the same | the same |'
    mark = '**' if row['needed'] else ''
    before, after = (f'{row[key]:.3g} +- {row[key + "_spread"]:.1g}' for key in ('with', 'without'))
    return f'| {row["feature"]} | {row["course"]} | {row["measure"]} | {before} | {mark}{after}{mark} |'


def source_id() -> str:
    """Return the commit, and a digest of what differs from it in the package."""
    root = Path(__file__).parents[3]
    head, diff = (subprocess.run(['git', *words], cwd=root, capture_output=True, check=True).stdout for words in (
        ('rev-parse', '--short', 'HEAD'), ('diff', 'HEAD', '--', 'dbscan_reg_ros')))
    return head.decode().strip() + (f'_{hashlib.sha256(diff).hexdigest()[:8]}' if diff else '')
