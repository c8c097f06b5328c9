# SPDX-License-Identifier: Apache-2.0
"""Key frames far apart: the odometry against the registration of each one to the one before.

A motion model that is too narrow rejects right registrations: the odometry must not be worse than its own
registrations, and must not fail where one of them is OK.
"""
import itertools
import math

import numpy as np

from dbscan_reg_ros.core.errors import RecordingError
from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.registration.records import Status
from dbscan_reg_ros.evaluation.methods import method
from dbscan_reg_ros.evaluation.metrics import errors
from dbscan_reg_ros.recordings import data_folder
from dbscan_reg_ros.recordings.poses import relative

from ..report import Report
from .bounds import SPARSE
from .drift import drive
from .hard_courses import sparse_aces, sparse_buildings, sparse_intel

TRANSLATION, ROTATION = 0.15, 3.0
"""A step is right within this [m], [deg]."""


def measure(args) -> Report:
    """Every thinned course; ``--limit N`` takes the first N key frames of each."""
    folder, report = data_folder(args.data), Report()
    for title, courses in (('intel', sparse_intel), ('aces', sparse_aces), ('buildings', sparse_buildings)):
        try:
            chosen = {name: course if args.limit is None else course.take(slice(args.limit))
                      for name, course in courses(folder).items()}
        except RecordingError as missing:
            print(f'left out: {title}: {missing}')
            continue
        for name in args.method or ('dbscan',):
            rows = {course: compared(name, chosen[course], course) for course in chosen}
            report.add_courses(title, grouped(rows), name, SPARSE if args.limit is None else None)
    return report


def compared(name, course, title) -> dict:
    """Return steps of the odometry beside registrations of each scan onto the one before it, without a guess.

    ``odometry`` and ``pairs``: the fraction of right steps of each; ``worse_count``: steps wrong in the odometry whose
    pair is right, and ``worse_ok_count`` whose pair is `OK` besides; ``failed_count``: scans called `FAILED`, and
    ``failed_ok_count`` those whose pair is `OK`; ``silent_count``: wrong steps between two scans called `OK`.
    """
    truth = relative(course.reference[:-1], course.reference[1:])
    run = drive(name, course, title)
    ok, failed = (np.array([step.status is status for step in run.steps]) for status in (Status.OK, Status.FAILED))
    odometry = right(relative(run.poses[:-1], run.poses[1:]), truth)
    found, sure = registered(method(name), course.scans)
    pairs = right(found, truth)
    return {'steps_count': len(truth), 'odometry': float(odometry.mean()), 'pairs': float(pairs.mean()),
            'worse_count': int((pairs & ~odometry).sum()), 'worse_ok_count': int((pairs & sure & ~odometry).sum()),
            'failed_count': int(failed[1:].sum()), 'failed_ok_count': int((failed[1:] & sure).sum()),
            'silent_count': int((~odometry & ok[1:] & ok[:-1]).sum())}


def right(motions, truth):
    """(N,) which of the motions (N, 3) are."""
    metres, degrees = errors(motions, truth)
    return (metres <= TRANSLATION) & (degrees <= ROTATION)


def registered(registration, scans):
    """(N - 1, 3) motions from each scan to the next, without a guess, and (N - 1,) whether they are called `OK`."""
    prepared = [registration.prepare(scan) for scan in scans]
    results = [registration.align(first, second) for first, second in itertools.pairwise(prepared)]
    motions = np.array([[r.transform.x, r.transform.y, r.transform.theta] if isinstance(r.transform,
                                                                                        SE2) else [math.nan] * 3
                        for r in results])
    return motions, np.array([r.status is Status.OK for r in results])


def grouped(rows) -> dict:
    """Return the courses of one kind and distance as one row: counts added up, shares weighted by steps."""
    groups: dict[str, list[dict]] = {}
    for name, row in rows.items():
        kind, *_, distance = name.removesuffix('_half').split('_')
        groups.setdefault(f'{kind}_{distance}', []).append(row)
    return {name: {metric: sum(row[metric] for row in some) if metric.endswith('_count') else
                   float(np.average([row[metric] for row in some], weights=[row['steps_count'] for row in some]))
                   for metric in some[0]} for name, some in groups.items()}
