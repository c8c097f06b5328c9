# SPDX-License-Identifier: Apache-2.0
"""The view ``silent`` of the odometry: motions that it calls OK and that are wrong, wherever the truth is known.

Judged are the motion from each scan to the next, and that to the first scan a metre farther on, when every scan of it
is called OK.

A wrong pose that is called OK is the worst fault of an odometry: none is allowed.
"""
import numpy as np

from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.metrics import apart, errors
from dbscan_reg_ros.recordings.poses import relative

from ..report import Report
from .bounds import SILENT
from .drift import OURS, chosen, drive
from .honesty import total

COURSES = ('intel', 'aces', 'lms511', 'rooms', 'corridors', 'halls', 'featureless', 'lidars', 'losses', 'bursts',
           'outages', 'trees', 'chairs')
TRANSLATION, ROTATION = 0.2, 5.0
"""A motion is wrong when it is off by more than this [m], [deg]."""


def measure(args) -> Report:
    """Every course; ``--limit N`` drives the first N scans of each, ``--verbose`` names the failures."""
    report = Report()
    for name in args.course or COURSES:
        found = [silent(drive(OURS, course, name)) for course in chosen(name, args)]
        report.add(name, {OURS: total([counts for counts, _ in found])}, SILENT, prefix=f'{name}_')
        if args.verbose:
            print('\n'.join(f'{name} {seed}: {line}' for seed, (_, lines) in enumerate(found) for line in lines))
    return report


def silent(drive):
    """Return counts and greatest errors, and a line for each failure, of a `Drive`."""
    poses, reference = drive.poses, drive.course.reference
    not_ok = np.array([step.status is not Status.OK for step in drive.steps])
    so_far = np.cumsum(not_ok)
    figures, lines = {'scans_count': len(poses), 'ok': float(np.mean(~not_ok))}, []
    each = np.arange(len(poses) - 1)
    for name, (first, last) in {'step': (each, each + 1), '1m': apart(reference, 1.0)}.items():
        sure = so_far[last] == so_far[first] - not_ok[first]
        first, last = first[sure], last[sure]
        metres, degrees = errors(relative(poses[first], poses[last]), relative(reference[first], reference[last]))
        wrong = (metres > TRANSLATION) | (degrees > ROTATION)
        figures |= {f'{name}_silent_count': int(wrong.sum()), f'{name}_worst_m': float(metres.max(initial=0.0)),
                    f'{name}_worst_deg': float(degrees.max(initial=0.0))}
        lines += [f'{name} from scan {a} to {b}: {m:.3f} m {d:.2f} deg'
                  for a, b, m, d in zip(first[wrong], last[wrong], metres[wrong], degrees[wrong], strict=True)]
    return figures, lines
