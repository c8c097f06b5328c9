# SPDX-License-Identifier: Apache-2.0
"""Error measures of trajectories as in public benchmarks, on arrays of poses ``(N, 3)`` [m, m, rad]."""
import math

import numpy as np

from ..core.geometry.se2 import wrap
from ..recordings.poses import compose, relative

NEIGHBOURS_WITHIN = 30_000_000_000
"""Relations over less time than this [ns] connect neighbouring scans; all other relations close loops."""
SAME_SCAN_WITHIN = 1_000_000
"""A stamp of a relation belongs to a scan if their stamps differ by less than this [ns]."""
LONGEST_GAP = 3
"""Longest time between two poses of a trajectory without a hole, in median intervals of the scans."""
MOVING_BEYOND = 0.03
"""A step between scans longer than this [m] in the reference is motion, not noise of the reference."""
FROZEN_BELOW = 0.5
"""A step between scans is frozen if its estimate is shorter than this fraction of the true step."""
JUMP_INTERVALS = 10.0
"""A step between stamps counts as a jump of the clock only if it exceeds this many times the median step."""


def errors(estimate, truth):
    """Return the errors of estimated motions ``(N, 3)``: of translation ``(N,)`` [m] and of rotation ``(N,)`` [deg]."""
    difference = relative(truth, estimate)
    return np.hypot(difference[:, 0], difference[:, 1]), np.degrees(np.abs(difference[:, 2]))


def summarize(name, estimate, truth) -> dict[str, float]:
    """Return mean, standard deviation, median and 95th percentile of `errors`, as ``NAME_STATISTIC_UNIT`` -> value."""
    summary: dict[str, float] = {}
    for unit, values in zip(('m', 'deg'), errors(estimate, truth), strict=True):
        if len(values):
            summary |= {f'{name}_mean_{unit}': float(values.mean()), f'{name}_std_{unit}': float(values.std()),
                        f'{name}_median_{unit}': float(np.median(values)),
                        f'{name}_p95_{unit}': float(np.percentile(values, 95))}
    return summary


def relation_errors(stamps, poses, relations) -> dict:
    """Compute the errors of the motions between related scans (Kuemmerle et al., Autonomous Robots 2009).

    Parameters
    ----------
    stamps : array_like (N,)
        Stamps of the poses [ns], in any order.
    poses : (N, 3)
    relations : Relations

    Returns
    -------
    dict
        ``relations`` is the number of relations with a pose for both scans. The errors are summarised (`summarize`) as
        ``relations_all``, ``relations_neighbour`` and ``relations_loop``.
    """
    first, second, found = related(stamps, relations)
    estimate = relative(poses[first], poses[second])
    truth = relations.motions[found]
    near = np.abs(relations.stamps[found, 1] - relations.stamps[found, 0]) < NEIGHBOURS_WITHIN
    return {'relations': int(found.sum()), **summarize('relations_all', estimate, truth),
            **summarize('relations_neighbour', estimate[near], truth[near]),
            **summarize('relations_loop', estimate[~near], truth[~near])}


def related(stamps, relations):
    """Return the indices of both scans of every relation whose scans are found, and the mask of these relations."""
    first, first_found = _scans_at(stamps, relations.stamps[:, 0])
    second, second_found = _scans_at(stamps, relations.stamps[:, 1])
    found = first_found & second_found
    return first[found], second[found], found


def step_errors(poses, reference) -> dict:
    """Compute the errors of the motions between consecutive scans (``step``), and the fraction of ``frozen`` steps.

    Steps from or to a scan without a true pose (NaN) are left out.

    A step is frozen if it is longer than 3 cm in the reference and its estimate is less than half as long.
    """
    known = np.isfinite(reference).all(axis=1)
    first = np.flatnonzero(known[:-1] & known[1:])
    step, true_step = (relative(each[first], each[first + 1]) for each in (poses, reference))
    length = np.hypot(true_step[:, 0], true_step[:, 1])
    moving = length > MOVING_BEYOND
    covered = (step[moving, :2] * true_step[moving, :2]).sum(axis=1) / length[moving] ** 2
    frozen = {'frozen': float((covered < FROZEN_BELOW).mean())} if len(covered) else {}
    return {**summarize('step', step, true_step), **frozen}


def distance_errors(poses, reference, metres) -> dict:
    """Compute the errors of the motion over `metres` of the reference path from each scan, such as ``rpe_5m``."""
    scans, later = apart(reference, metres)
    return summarize(f'rpe_{metres:g}m', relative(poses[scans], poses[later]),
                     relative(reference[scans], reference[later]))


def apart(reference, metres, scans=None):
    """Return indices of scans, and for each the index of the first scan `metres` farther on the reference path.

    No scan lies between the two whose pose in the reference is unknown (NaN), and no hole.

    Parameters
    ----------
    reference : (N, 3) float [m, m, rad]
    metres : float
    scans : (N,) int, optional
        Numbers of the scans, if some lack a row; more than `LONGEST_GAP` from one to the next are a hole.
    """
    is_known = np.isfinite(reference).all(axis=1)
    known = np.flatnonzero(is_known)
    path = path_lengths(reference[known])
    later = np.searchsorted(path, path + metres)
    first = np.flatnonzero(later < len(path))
    first, later = known[first], known[later[first]]
    unknown = np.cumsum(~is_known)
    if scans is not None:
        unknown += _part(scans)
    within = unknown[first] == unknown[later]
    return first[within], later[within]


def without_holes(known) -> list:
    """Return the rows of each part of a trajectory between its holes, where ``known`` ``(N,)`` rows have a pose."""
    rows = np.flatnonzero(known)
    return np.split(rows, np.flatnonzero(np.diff(_part(rows))) + 1)


def _part(rows):
    """Return the number of the part between two holes for each of the increasing `rows` ``(K,)``."""
    return np.cumsum(np.diff(rows, prepend=rows[:1]) > LONGEST_GAP)


def path_lengths(poses):
    """Return the path length from the first pose to each pose ``(N,)`` [m]."""
    steps = relative(poses[:-1], poses[1:])
    return np.concatenate(([0.0], np.cumsum(np.hypot(steps[:, 0], steps[:, 1]))))


def duration(stamps, jump):
    """Return the time [s] covered by `stamps` ``(N,)`` [ns] without gaps and jumps, and how many these are.

    A gap or jump is a step of more than `jump` [s] that is also more than ten times the median step, because the stamps
    of key frames lie far apart.
    """
    steps = np.diff(np.asarray(stamps, dtype=np.int64)) * 1e-9
    if not len(steps):
        return 0.0, 0
    length = np.abs(steps)
    jumps = length > max(jump, JUMP_INTERVALS * float(np.median(length)))
    return max(float(steps[~jumps].sum()), 0.0), int(jumps.sum())


def align(poses, reference):
    """Move `poses` by the one rigid motion that brings their positions closest to `reference`, by least squares."""
    centre, true_centre = poses[:, :2].mean(axis=0), reference[:, :2].mean(axis=0)
    a, b = poses[:, :2] - centre, reference[:, :2] - true_centre
    angle = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    c, s = math.cos(angle), math.sin(angle)
    return np.column_stack((c * a[:, 0] - s * a[:, 1] + true_centre[0], s * a[:, 0] + c * a[:, 1] + true_centre[1],
                            wrap(poses[:, 2] + angle)))


def begun_like(poses, reference):
    """Move `poses` by the rigid motion that brings the first known one onto the `reference`; NaN stands for unknown."""
    known = np.flatnonzero(np.isfinite(poses).all(axis=1))
    if not len(known):
        return poses
    start, there = (np.broadcast_to(rows[known[0]], poses.shape) for rows in (poses, reference))
    return compose(there, relative(start, poses))


def absolute_error(poses, reference) -> float:
    """Return the root mean square position error after the best rigid alignment [m], where the reference is known."""
    known = np.isfinite(reference).all(axis=1)
    difference = (align(poses[known], reference[known]) - reference[known])[:, :2]
    return float(np.sqrt((difference ** 2).sum(axis=1).mean()))


def final_error(poses, reference) -> dict:
    """Return the error of the motion from first to last pose (``final_m``, ``final_deg``) and the length ``path_m``."""
    ends = poses[:1], poses[-1:], reference[:1], reference[-1:]
    metres, degrees = errors(relative(*ends[:2]), relative(*ends[2:]))
    return {'final_m': float(metres[0]), 'final_deg': float(degrees[0]), 'path_m': float(path_lengths(reference)[-1])}


def evaluate(poses, stamps=None, relations=None, reference=None) -> dict:
    """Compute every error measure for which a truth (`relations`, `reference`) is given.

    Parameters
    ----------
    poses : (N, 3)
        Estimated poses in the order of the scans.
    stamps : array_like (N,), optional
        Stamps of the poses [ns]; needed with `relations`.
    relations : Relations, optional
    reference : (N, 3), optional
        The true pose of each scan, in any fixed frame; NaN where it is unknown.

    Returns
    -------
    dict
        Measure -> value, as in `relation_errors`, `step_errors`, `distance_errors` and ``ate_m``.
    """
    measures: dict[str, float] = {}
    if relations is not None:
        measures |= relation_errors(stamps, poses, relations)
    if reference is not None:
        measures |= step_errors(poses, reference)
        measures |= distance_errors(poses, reference, 1.0) | distance_errors(poses, reference, 5.0)
        measures['ate_m'] = absolute_error(poses, reference)
    return measures


def _scans_at(stamps, moments):
    """Return for each of the `moments` ``(R,)`` [ns] the index of the scan at that time, and whether there is one."""
    stamps = np.asarray(stamps, dtype=np.int64)
    if not len(stamps):
        return np.zeros(len(moments), dtype=int), np.zeros(len(moments), dtype=bool)
    order = np.argsort(stamps, kind='stable')
    place = np.searchsorted(stamps[order], moments - SAME_SCAN_WITHIN // 2)
    index = order[np.minimum(place, len(stamps) - 1)]
    return index, np.abs(stamps[index] - moments) < SAME_SCAN_WITHIN
