# SPDX-License-Identifier: Apache-2.0
"""The view ``worst`` of the odometry: the largest errors of a drive, and what was called OK and was wrong.

It is for courses on which most scans are easy and a few decide: a mean does not show one jump. A step or a stretch of a
drive that is wrong although every scan of it is `OK` misleads whoever uses the poses, so the bound is none of them
where people, doors or a curve move the view. A robot that rotates in place is controlled by the published turn rates:
their error may be 0.03 rad/s, and three of the published standard deviations have to hold 97 % of the errors.
"""
import numpy as np
from scipy.interpolate import CubicSpline

from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.metrics import apart, errors
from dbscan_reg_ros.recordings.poses import relative

from ..report import Report
from .bounds import WORST
from .drift import chosen, drive, pose_within

COURSES = ('passers', 'covered', 'spin', 'spinup', 'narrow', 'curved', 'stops', 'pillar', 'doors', 'companions')
SEEDS = 10
METHODS = ('dbscan', 'small_gicp', 'kiss-icp')
STEP = 0.1, 3.0
"""A step off by more than this [m], [deg] is wrong."""
STRETCH = 0.2, 5.0
"""A stretch of `STRETCH_SECONDS` off by more than this [m], [deg] is wrong."""
STRETCH_SECONDS = 2.0
SETTLED = 5
"""Scans at the start of a rotation that are not judged."""


def measure(args) -> Report:
    """Return a table for each course and method: a row for each kind of drive, and one for all drives."""
    report = Report()
    for name in args.course or COURSES:
        courses = chosen(name, args, SEEDS)
        for method in args.method or METHODS:
            rows = [figures(drive(method, course, f'{name} {method}'), EXTRA.get(name)) for course in courses]
            groups = {course.group: [row for each, row in zip(courses, rows, strict=True) if each.group == course.group]
                      for course in courses}
            table = {f'{name}_{group}': summary(each) for group, each in groups.items()} if len(groups) > 1 else {}
            report.add_courses(name, table | {name: summary(rows)}, method, WORST)
    return report


def figures(run, extra=None) -> dict:
    """Of one `Drive`: the largest error of the pose by the truth, and what was called `OK` and was wrong.

    ``error_m``, ``error_deg``: the largest error against the first judged scan; ``step_ok_m``: the largest error of a
    step between two scans called `OK`; ``silent_count``: steps between `OK` scans that are off by more than 0.1 m or 3
    deg; ``stretches_count``: stretches of 2 s, all `OK`, that are off by more than 0.2 m or 5 deg; ``over_1m_m``: the
    median error over 1 m; ``within`` as `drift.judge`; ``ok`` and ``failed``: the fraction of the scans with each
    status. `extra(run)` has figures of its own.
    """
    course, poses = run.course, run.poses
    reference, seconds = course.reference, course.seconds
    status = np.array([step.status for step in run.steps], dtype=object)
    ok = status == Status.OK
    off = poses - relative(reference[:1], reference)
    off = off - off[np.argmax(course.judged)]
    each = np.arange(len(poses) - 1)
    later = np.searchsorted(seconds, seconds + STRETCH_SECONDS)
    first = np.flatnonzero(later < len(poses))
    metres, _, steps = wrong(poses, reference, ok, each, each + 1, STEP)
    _, _, stretches = wrong(poses, reference, ok, first, later[first], STRETCH)
    found = {'scans_count': int(course.judged.sum()), 'error_m': float(np.hypot(*off[course.judged, :2].T).max()),
             'error_deg': float(np.degrees(np.abs(wrap(off[course.judged, 2])).max())),
             'step_ok_m': float(metres.max(initial=0.0)), 'silent_count': steps, 'stretches_count': stretches,
             'ok': float(ok[course.judged].mean()), 'failed': float((status == Status.FAILED)[course.judged].mean())}
    first, last = apart(reference, 1.0)
    if len(first):
        metres, _ = errors(relative(poses[first], poses[last]), relative(reference[first], reference[last]))
        found['over_1m_m'] = float(np.median(metres))
    if all(step.covariance is not None for step in run.steps):
        found['within'] = pose_within(run)
    return found | (extra(run) if extra else {})


def wrong(poses, reference, ok, first, last, limits):
    """Errors [m], [deg] from scans `first` to `last` where all scans are `OK`, and how many are wrong."""
    not_ok = np.concatenate(([0], np.cumsum(~ok)))
    sure = not_ok[last + 1] == not_ok[first]
    first, last = first[sure], last[sure]
    metres, degrees = errors(relative(poses[first], poses[last]), relative(reference[first], reference[last]))
    return metres, degrees, int(((metres > limits[0]) | (degrees > limits[1])).sum())


def of_covered(run) -> dict:
    """``late_s``: from the first scan without the box to the first `OK` one."""
    course = run.course
    first = int(np.flatnonzero(~course.judged).max(initial=-1)) + 1
    ok = [k for k in range(first, len(run.steps)) if run.steps[k].status is Status.OK]
    late = course.seconds[ok[0] if ok else -1] - course.seconds[min(first, len(run.steps) - 1)]
    return {'late_s': float(late)}


def of_spinup(run) -> dict:
    """``failed_count``: judged scans that are `FAILED`; ``late_s``: from the first judged scan to the last of these."""
    failed = np.array([step.status is Status.FAILED for step in run.steps]) & run.course.judged
    seconds = run.course.seconds - run.course.seconds[np.argmax(run.course.judged)]
    return {'failed_count': int(failed.sum()), 'late_s': float(seconds[failed].max(initial=0.0))}


def of_spin(run) -> dict:
    """Of published turn rates, against the true ones between the middles of the scans; other methods have none.

    ``rate_rms_deg``: error [deg/s]; ``rate_within``: the fraction within three standard deviations.
    """
    course, scan = run.course, run.course.scans[0]
    heading = CubicSpline(course.seconds, np.unwrap(course.reference[:, 2]))
    half = 0.5 * scan.time_increment * scan.geometry.size
    judged = [k for k in range(SETTLED, len(run.steps) - 1) if run.steps[k].twist is not None]
    if not judged:
        return {}
    rates, sigmas, intervals = np.array([
        (step.twist[2], np.sqrt(step.twist_covariance[2, 2]), step.interval) for step in map(run.steps.__getitem__,
                                                                                            judged)]).T
    middles = course.seconds[judged] + half
    off = wrap(rates * intervals - heading(middles) + heading(middles - intervals)) / intervals
    return {'rate_rms_deg': float(np.degrees(np.sqrt((off ** 2).mean()))),
            'rate_within': float((np.abs(off) < 3.0 * sigmas).mean())}


EXTRA = {'covered': of_covered, 'spinup': of_spinup, 'spin': of_spin}
"""Course -> figures of its own."""


def summary(rows) -> dict:
    """Median and worst of the errors, counts added up; of shares and root mean squares that of all scans."""
    result: dict[str, float] = {}
    weights = [row['scans_count'] for row in rows]
    for name in rows[0]:
        if not all(name in row for row in rows):
            continue
        values = np.array([row[name] for row in rows])
        if name.endswith('_count'):
            result[name] = int(values.sum())
        elif name.endswith('_rms_deg'):
            result[name] = float(np.sqrt(np.average(values ** 2, weights=weights)))
        elif name.endswith(('_m', '_deg', '_s')):
            head, unit = name.rsplit('_', 1)
            result |= {f'{head}_median_{unit}': float(np.median(values)),
                       f'{head}_worst_{unit}': float(values.max())}
        else:
            result[name] = float(np.average(values, weights=weights))
    return result
