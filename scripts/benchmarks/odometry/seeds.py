# SPDX-License-Identifier: Apache-2.0
"""Odometry of one course for each of several seeds: medians, the worst, and what was called OK and was wrong."""
import numpy as np

from dbscan_reg_ros.core.geometry.se2 import wrap
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.metrics import errors
from dbscan_reg_ros.recordings.poses import relative

from .drift import drive

SEEDS = tuple(range(10))
METHODS = ('dbscan', 'small_gicp', 'kiss-icp')
STEP = 0.1, 3.0
"""A step off by more than this [m], [deg] is wrong."""
STRETCH = 0.2, 5.0
"""A stretch of `STRETCH_SECONDS` off by more than this [m], [deg] is wrong."""
STRETCH_SECONDS = 2.0


def figures(run) -> dict:
    """Of one `Drive`: the largest error of the pose by the truth, and what was called `OK` and was wrong.

    ``error_m``, ``error_deg``: the largest error against the first scan; ``step_ok_m``: the largest error of a step
    between two scans called `OK`; ``silent_count``: steps between `OK` scans that are off by more than 0.1 m or 3 deg;
    ``stretches_count``: stretches of 2 s, all `OK`, that are off by more than 0.2 m or 5 deg; ``ok`` and ``failed``:
    the fraction of the scans with each status.
    """
    course, poses = run.course, run.poses
    reference, seconds = course.reference, course.seconds
    status = [step.status for step in run.steps]
    ok = np.array([each is Status.OK for each in status])
    off = poses - relative(reference[:1], reference)
    off = off - off[np.argmax(course.judged)]
    each = np.arange(len(poses) - 1)
    later = np.searchsorted(seconds, seconds + STRETCH_SECONDS)
    first = np.flatnonzero(later < len(poses))
    metres, _, steps = wrong(poses, reference, ok, each, each + 1, STEP)
    _, _, stretches = wrong(poses, reference, ok, first, later[first], STRETCH)
    return {'error_m': float(np.hypot(off[:, 0], off[:, 1])[course.judged].max()),
            'error_deg': float(np.degrees(np.abs(wrap(off[:, 2])))[course.judged].max()),
            'step_ok_m': float(metres.max(initial=0.0)), 'silent_count': steps, 'stretches_count': stretches,
            'ok': float(ok[course.judged].mean()),
            'failed': float(np.mean([each is Status.FAILED for each in np.array(status, dtype=object)[course.judged]]))}


def wrong(poses, reference, ok, first, last, limits):
    """Errors [m], [deg] from scans `first` to `last` where all scans are `OK`, and how many are wrong."""
    not_ok = np.concatenate(([0], np.cumsum(~ok)))
    sure = not_ok[last + 1] == not_ok[first]
    first, last = first[sure], last[sure]
    metres, degrees = errors(relative(poses[first], poses[last]), relative(reference[first], reference[last]))
    return metres, degrees, int(((metres > limits[0]) | (degrees > limits[1])).sum())


def summary(rows) -> dict:
    """Median and worst of the errors, counts added up, means of the shares."""
    def values(name):
        return np.array([row[name] for row in rows])
    result: dict[str, float] = {}
    for name in rows[0]:
        if name.endswith('_count'):
            result[name] = int(values(name).sum())
        elif name.endswith(('_m', '_deg', '_s')):
            head, unit = name.rsplit('_', 1)
            result |= {f'{head}_median_{unit}': float(np.median(values(name))),
                       f'{head}_worst_{unit}': float(values(name).max())}
        else:
            result[name] = float(values(name).mean())
    return result


def judged(args, groups, title, judge=figures, methods=METHODS) -> dict:
    """Return method -> course -> metric -> number, for `groups`: name -> list of courses.

    ``--limit N`` takes N scans of each.
    """
    table = {}
    for method in args.method or methods:
        for name, courses in groups.items():
            rows = [judge(drive(method, course if args.limit is None else course.take(slice(args.limit)),
                                f'{title} {method}'))
                    for course in courses]
            table.setdefault(method, {})[name] = summary(rows)
    return table
