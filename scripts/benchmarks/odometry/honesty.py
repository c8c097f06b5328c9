# SPDX-License-Identifier: Apache-2.0
"""Whether the odometry knows its errors: changes of the pose against what the published covariances allow.

The covariance of a change is that of the twists in between, whose errors are taken as fully correlated. Where the
covariance of the pose grew by less, it is this growth, but at least what the twists of the first and last scan allow.
Where it shrank, the pose may have been corrected: the change may be off by as much besides.

Whoever uses the odometry trusts its covariances: no scan that is OK may be off by more than five sigma, and 97 % of all
changes have to be within three.
"""
import numpy as np

from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.core.parameters.tree import Parameters
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.metrics import errors, final_error, path_lengths
from dbscan_reg_ros.recordings.poses import relative

from ..report import Report
from .bounds import HONESTY
from .courses import COURSES
from .drift import OURS, chosen, drive

SIGMAS, SILENT_SIGMAS = 3.0, 5.0
SHORT, LONG = (0.5, 1.0, 2.0), (1.0, 5.0)
"""Windows [s] over which `OK` scans, and all scans, are judged."""
STEP = 0.25, 3.0
"""A step between two `OK` scans that is off by more than this [m], [deg] is wrong."""
TURNED = 45.0
"""A robot whose heading is off by more than this [deg] is turned."""
END = 0.3, 5.0
"""A drive is right at its end within this [m], [deg]."""
LEAST = 1e-12
"""Smallest variance, and smallest ratio of two."""


def measure(args) -> Report:
    """Return a table for each course, with a row for each kind of drive."""
    report = Report()
    for name in args.course or COURSES:
        groups: dict[str, list[dict]] = {}
        for course in chosen(name, args):
            row = figures(drive(OURS, course, f'{name} {course.group}', args.prior))
            groups.setdefault('_'.join(filter(None, (name, course.group))), []).append(row)
        rows = {group: total(each) for group, each in groups.items()}
        report.add_courses(f'{name}, prior {args.prior}', rows, OURS, dict.fromkeys(rows, HONESTY))
    return report


def figures(run) -> dict:
    """Metric -> number of one `Drive`; scans without a published twist are left out.

    ``silent_count`` and ``silent``: number and fraction of the scans called `OK` whose pose changed wrongly over 0.5, 1
    or 2 s, by more than five sigma; ``ratio_worst``: by how many sigma at most. ``steps_within``, ``1s_within``,
    ``5s_within``: the fraction of all changes that are off by less than three sigma, whatever the status,
    and ``pose_within`` that of the poses. ``wrong_count``: steps between `OK` scans that are off by more than 0.25 m or
    3 deg; ``fast_count``: steps beyond ``max_speed`` or ``max_turn_rate``; ``turned_count``: 1 if the heading of an
    `OK` scan is off by more than 45 deg. ``final_m``: the error at the end, ``right``: 1 if this is below 0.3 m and 5
    deg; ``driven_worst_m``: the error of the length of the path. Medians of the published sigmas: ``sigma_m`` and
    ``sigma_deg`` of the pose, ``rate_sigma_m`` and ``rate_sigma_deg`` of the twist. ``step_nees`` and ``pose_nees``:
    mean squared error of steps and poses in units of their covariance, by three.
    """
    published = Published(run)
    ok, last = published.ok, np.arange(1, len(published.poses))
    ratios = np.zeros(len(ok))
    for seconds in SHORT:
        first, later = published.windows(seconds)
        np.maximum.at(ratios, later, published.change_sigmas(first, later))
    steps = published.change_sigmas(last - 1, last)
    poses = published.pose_sigmas()
    end = final_error(published.poses, published.reference)
    heading = np.degrees(np.abs(published.pose_errors()[:, 2]))
    pose, twist = (_medians(each) for each in (published.covariances, published.twist_covariances))
    return {
        'scans_count': int(run.course.judged.sum()), 'ok': float(ok.sum() / run.course.judged.sum()),
        'silent_count': int((ratios[ok] > SILENT_SIGMAS).sum()), 'silent': _share(ratios[ok] > SILENT_SIGMAS),
        'ratio_worst': float(ratios[ok].max(initial=0.0)),
        'steps_within': _share(steps < SIGMAS),
        **{f'{seconds:g}s_within': _share(published.change_sigmas(*published.windows(seconds)) < SIGMAS)
           for seconds in LONG},
        'pose_within': _share(poses < SIGMAS), 'final_m': end['final_m'], 'final_worst_m': end['final_m'],
        'final_worst_deg': end['final_deg'], 'right': float(end['final_m'] < END[0] and end['final_deg'] < END[1]),
        'driven_worst_m': published.driven_off(), 'wrong_count': published.wrong_steps(),
        'fast_count': published.fast_steps(), 'turned_count': int((heading[ok] > TURNED).any()),
        'sigma_m': pose[0], 'sigma_deg': pose[1], 'rate_sigma_m': twist[0], 'rate_sigma_deg': twist[1],
        'step_nees': float((steps ** 2).mean() / 3.0), 'pose_nees': float((poses ** 2).mean() / 3.0)}


class Published:
    """Poses, covariances and truth of the judged scans of a `Drive` with a published twist and a known true pose.

    Where stamps jitter, a step takes at least the filtered time since the last scan.

    Attributes
    ----------
    poses, reference : (N, 3) float
    covariances, twist_covariances : (N, 3, 3) float
    seconds : (N,) float
    ok : (N,) bool
    """

    def __init__(self, run):
        course = run.course
        kept = course.judged & np.isfinite(course.reference).all(axis=1) \
            & np.array([step.twist_covariance is not None for step in run.steps])
        steps = [run.steps[k] for k in kept.nonzero()[0]]
        self.poses, self.reference, self.seconds = run.poses[kept], course.reference[kept], course.seconds[kept]
        self.covariances = np.array([step.covariance for step in steps])
        self.twist_covariances = np.array([step.twist_covariance for step in steps])
        self.ok = np.array([step.status is Status.OK for step in steps])
        metres, radians = course.truth_sigma
        self._truth = np.diag((metres, metres, radians)) ** 2
        self._intervals = np.maximum(np.diff(self.seconds, prepend=self.seconds[0]), [step.interval for step in steps])
        self._steps = self._intervals[:, None, None] * _roots(self.twist_covariances)
        self._turn = _turns(self.poses[:, 2])
        self._sums = np.cumsum(_adjoints(self.poses) @ self._steps @ self._turn.transpose(0, 2, 1), axis=0)

    def windows(self, seconds):
        """Return indices of scans and, for each, of the last one at least so many `seconds` before: first, last."""
        first = np.searchsorted(self.seconds, self.seconds - seconds + 1e-6, side='right') - 1
        last = np.flatnonzero(first >= 0)
        return first[last], last

    def change_sigmas(self, first, last):
        """(K,) errors of the changes from scans `first` to `last`, in standard deviations."""
        off = relative(relative(self.reference[first], self.reference[last]),
                       relative(self.poses[first], self.poses[last]))
        root = np.linalg.solve(_adjoints(self.poses[last]), self._sums[last] - self._sums[first]) @ self._turn[last]
        turned = self._turn[last].transpose(0, 2, 1) @ self._turn[first]
        twists, begin, end = (each @ each.transpose(0, 2, 1)
                              for each in (root, turned @ self._steps[first], self._steps[last]))
        carried = np.zeros_like(twists) + np.eye(3)
        carried[:, 0, 2] = self.poses[first, 1] - self.poses[last, 1]
        carried[:, 1, 2] = self.poses[last, 0] - self.poses[first, 0]
        growth = self.covariances[last] - carried @ self.covariances[first] @ carried.transpose(0, 2, 1)
        growth = self._turn[last].transpose(0, 2, 1) @ growth @ self._turn[last]
        lower = np.linalg.cholesky(twists + self._truth + LEAST * np.eye(3))
        growth, least = (_whitened(each + self._truth, lower) for each in (growth, begin + end))
        ratio, directions = np.linalg.eigh(growth)
        least = np.einsum('kji,kjl,kli->ki', directions, least, directions)
        along = np.einsum('kji,kj->ki', directions, np.linalg.solve(lower, off[..., None])[..., 0])
        variance = np.where(ratio < 0.0, 1.0 - ratio, np.clip(ratio, np.clip(least, LEAST, 1.0), 1.0))
        return np.sqrt((along ** 2 / variance).sum(axis=1))

    def pose_errors(self):
        """``(N, 3)`` errors of the poses [m, m, rad], in the frame of the first scan."""
        off = self.poses - self.poses[0] - relative(self.reference[:1], self.reference)
        return np.column_stack((off[:, :2], wrap(off[:, 2])))

    def pose_sigmas(self):
        """``(N,)`` errors of the poses, in standard deviations."""
        off = self.pose_errors()
        return np.sqrt(np.einsum('ni,ni->n', off, np.linalg.solve(
            self.covariances + self._truth + LEAST * np.eye(3), off[..., None])[..., 0]))

    def driven_off(self) -> float:
        """Return the error of the length of the path [m]."""
        return abs(float(path_lengths(self.poses)[-1] - path_lengths(self.reference)[-1]))

    def wrong_steps(self) -> int:
        """Count steps between `OK` scans that are off by more than `STEP`."""
        step, truth = (relative(each[:-1], each[1:]) for each in (self.poses, self.reference))
        metres, degrees = errors(step, truth)
        return int(((metres > STEP[0]) | (degrees > STEP[1]))[self.ok[1:] & self.ok[:-1]].sum())

    def fast_steps(self) -> int:
        """Count steps that are faster than the odometry allows."""
        limits, seconds = Parameters().odometry, self._intervals[1:]
        step = relative(self.poses[:-1], self.poses[1:])
        return int(((np.hypot(step[:, 0], step[:, 1]) > limits.max_speed * seconds)
                    | (np.abs(step[:, 2]) > limits.max_turn_rate * seconds)).sum())


def total(rows) -> dict:
    """Return the figures of several drives as one: counts added up, the greatest errors, the mean of all others."""
    def one(name):
        values = [row[name] for row in rows]
        return sum(values) if name.endswith('_count') else max(values) if 'worst' in name else float(np.mean(values))
    return {name: one(name) for name in rows[0]}


def _share(found):
    return float(found.mean()) if len(found) else float('nan')


def _medians(covariances):
    """Return the median sigma of the least certain direction [m] and of the heading [deg]."""
    metres = np.sqrt(np.linalg.eigvalsh(covariances[:, :2, :2])[:, -1])
    return float(np.median(metres)), float(np.degrees(np.median(np.sqrt(covariances[:, 2, 2]))))


def _roots(covariances):
    """(N, 3, 3) symmetric square roots."""
    variance, directions = np.linalg.eigh(covariances)
    return (directions * np.sqrt(np.maximum(variance, 0.0))[:, None]) @ directions.transpose(0, 2, 1)


def _whitened(covariances, lower):
    half = np.linalg.solve(lower, covariances)
    return np.linalg.solve(lower, half.transpose(0, 2, 1))


def _turns(angles):
    """``(N, 3, 3)`` rotations of x and y by `angles` [rad]."""
    turns = np.zeros((len(angles), 3, 3))
    c, s = np.cos(angles), np.sin(angles)
    turns[:, 0, 0], turns[:, 0, 1], turns[:, 1, 0], turns[:, 1, 1], turns[:, 2, 2] = c, -s, s, c, 1.0
    return turns


def _adjoints(poses):
    """``(N, 3, 3)`` matrices that carry twists in the frames of the `poses` to the frame in which these are given."""
    adjoints = _turns(poses[:, 2])
    adjoints[:, 0, 2], adjoints[:, 1, 2] = poses[:, 1], -poses[:, 0]
    return adjoints
