# SPDX-License-Identifier: Apache-2.0
"""Series along a drive for the page of a replay: one value for each scan that is kept."""
from itertools import pairwise

import numpy as np

from ...core.registration.records import Status
from ...evaluation.metrics import align, apart, begun_like, errors, path_lengths, related
from ...places.localizer import State
from ...recordings import interpolate
from ...recordings.poses import relative
from .encoding import packed, rounded
from .scan_history import RESOLUTION, packed_scans

DRIVE = 1.0
"""If the distance driven is shorter than this [m], the axis of the plots is the scan number instead."""
METRES = 1.0
"""Distance [m] of the motion whose errors are plotted."""
LONGEST_STEP = 1.0
"""When the drive is played, steps of the stamps longer than this [s] are shortened to it, and negative steps to 0."""
MOST_POSES = 20_000
"""Largest number of key frames, and of loops, that are drawn."""
KINDS = 5
"""Number of different colours for competitors."""
LEVELS = [status.value for status in Status]
STATES = list(State)


def drive_data(report) -> dict:
    """Return the data that the page shows for each stored scan of the drive; arrays are packed as texts.

    If scans were dropped, each error or time is the largest value from a stored scan up to the next stored scan.
    """
    trajectory, records = report.trajectory, report.history.records()
    records = [record for record in records if record.number < len(trajectory.poses)]
    kept = np.array([record.number for record in records], dtype=int)
    poses, scans = trajectory.pose_array(), trajectory.used_numbers
    distance = path_lengths(poses) if len(poses) else np.zeros(0)
    moved = not len(distance) or distance[-1] >= DRIVE
    along = distance if moved else scans.astype(float)
    sources = [record.reference_number for record in records]
    others = [*known_lines(report.known, trajectory.stamps, poses), *competitor_lines(trajectory, report.competitors)]
    reasons = list(dict.fromkeys(record.reason for record in records))
    number_of = {reason: number for number, reason in enumerate(reasons)}
    return {
        'count': len(kept), 'dropped': _dropped(report.history, len(poses), len(kept)),
        'along': {'label': 'distance driven [m]' if moved else 'scan', 'unit': 'm' if moved else '',
                  'end': max(float(along.max(initial=0.0)), 1.0), 'at': packed(along[kept])},
        'scan': packed(scans[kept], '<i4'), 'time': packed(_playing_time(trajectory.stamps)[kept]),
        'pose': packed(poses[kept]), 'distance': packed(distance[kept]),
        'sigma': packed(_ellipses([record.covariance for record in records])),
        'status': packed([LEVELS.index(record.status.value) for record in records], '<u1'),
        'reason': packed([number_of[record.reason] for record in records], '<i4'), 'reasons': reasons,
        'overlap': packed([record.overlap for record in records]),
        'reference': packed([scans[source] if source >= 0 else -1 for source in sources], '<i4'),
        'statusNames': LEVELS, 'resolution': RESOLUTION,
        'points': packed([len(record.points) for record in records], '<u2'),
        'segments': packed([len(record.segments) for record in records], '<u2'),
        'others': [{'kind': kind, 'name': name, 'at': packed(path[kept])} for kind, name, path in others],
        'keyFrames': _key_frames(records, poses, report.closed), 'closed': _closed(report.closed, poses, kept),
        'inMap': _in_map(report.in_map, kept),
        'plots': [*_error_plots(report.known, trajectory.stamps, poses, kept), *_competitor_plots(report, kept),
                  *_time_plot(trajectory.milliseconds, kept)],
        'scans': packed_scans(records),
    }


def _dropped(history, used, kept):
    """Describe which scans and beams the page leaves out; empty if it shows all."""
    parts = [f'every {step}. scan with status {name}' for step, name in
             ((history.scan_step, 'OK'), (history.not_ok_step, 'other than OK')) if step > 1]
    if history.scan_step > 1 and history.not_ok_step == 1:
        parts.append('every scan with another status')
    if history.beam_step > 1:
        parts.append(f'every {history.beam_step}. return of each scan')
    return f'The page holds {kept} of {used} scans: {", ".join(parts)}.' if parts else ''


def _playing_time(stamps):
    """Return the time since the first scan ``(N,)`` [s], without jumps and gaps of the stamps."""
    steps = np.diff(np.asarray(stamps, dtype=np.int64)) * 1e-9
    return np.concatenate(([0.0][:len(stamps)], np.cumsum(np.clip(steps, 0.0, LONGEST_STEP))))


def _ellipses(covariances):
    """Return ellipses ``(K, 4)``: semi-axes [m], direction of the longer one [rad], deviation of theta [rad]."""
    covariances = np.array(covariances).reshape(-1, 3, 3)
    values, vectors = np.linalg.eigh(covariances[:, :2, :2])
    axes = np.sqrt(np.maximum(values, 0.0))
    return np.column_stack((axes[:, 1], axes[:, 0], np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]),
                            np.sqrt(covariances[:, 2, 2])))


def known_lines(known, stamps, poses):
    """Yield kind, name and positions ``(N, 2)`` of known trajectories, aligned with the odometry."""
    for kind, name, other in (('truth', 'truth', known.truth), ('wheels', 'wheel odometry', known.wheels)):
        if other is None:
            continue
        path = known.true_poses(stamps).poses if kind == 'truth' else interpolate(*other, stamps)
        there = np.isfinite(path).all(axis=1)
        if np.count_nonzero(there) <= 1:
            continue
        if kind == 'truth':
            path[there] = align(path[there], poses[there])
        else:
            path = begun_like(path, poses)
        yield kind, name, path[:, :2]


def competitor_poses(trajectory, other):
    """Return the poses ``(N, 3)`` of a competitor at the scans of the first trajectory; nan if it lacks a pose."""
    poses = np.full((len(trajectory.used), 3), np.nan)
    poses[np.flatnonzero(other.used)] = other.pose_array()
    return poses[np.flatnonzero(trajectory.used)]


def competitor_lines(ours, competitors):
    """Yield kind, name and positions ``(N, 2)`` of the competitors at the scans of the first trajectory.

    Each is moved so that its first common pose with the first trajectory is the same, as its frame may be another.

    Parameters
    ----------
    ours : Trajectory
    competitors : list of (str, Trajectory)
        Name and trajectory of each competitor.
    """
    poses = ours.pose_array()
    for place, (name, trajectory) in enumerate(competitors):
        path = competitor_poses(ours, trajectory)
        if np.isfinite(path).any():
            yield f'other{place % KINDS}', name, begun_like(path, poses)[:, :2]


def _competitor_plots(report, kept):
    """Yield the plots of the errors of each competitor along the drive."""
    for place, (name, trajectory) in enumerate(report.competitors):
        poses = competitor_poses(report.trajectory, trajectory)
        there = np.isfinite(poses).all(axis=1)
        stamps, numbers = np.array(report.trajectory.stamps, dtype=np.int64)[there], np.flatnonzero(there)
        for plot, values in _errors(report.known, stamps, poses[there], numbers):
            row = np.full(len(poses), np.nan)
            row[numbers] = values
            yield plot | {'id': f'{plot["id"]}-{place}', 'kind': f'other{place % KINDS}',
                          'name': f'{plot["name"]} of {name}', 'short': f'{plot["short"]} of {name}',
                          'values': packed(_largest(row, kept))}


def _thinned(rows):
    return rows[::-(-len(rows) // MOST_POSES) or 1]


def _key_frames(records, poses, closed):
    """Return the positions of the stored key frames, before and after loop closing."""
    numbers = _thinned(np.array([record.number for record in records if record.key_frame], dtype=int))
    return {'open': packed(poses[numbers, :2]), 'closed': packed(closed.poses[numbers, :2]) if closed else ''}


def _closed(closed, poses, kept):
    """Return the poses after loop closing, and the two scan positions of each loop before and after loop closing."""
    if not closed:
        return None
    pairs = _thinned(np.asarray(closed.pairs, dtype=int).reshape(-1, 2))
    return {'pose': packed(closed.poses[kept]), 'count': len(closed.pairs),
            'loops': {'open': packed(poses[pairs, :2]), 'closed': packed(closed.poses[pairs, :2])}}


def _in_map(in_map, kept):
    """Return state, covariance and places of each stored scan in the map of a file."""
    if not in_map:
        return None
    moments, places = [in_map.moments[number] for number in kept], [in_map.places(number) for number in kept]
    return {'stateNames': [state.value for state in STATES],
            'state': packed([STATES.index(moment.state) for moment in moments], '<u1'),
            'sigma': packed(_ellipses([moment.covariance for moment in moments])),
            'counts': packed([len(rows) for rows in places], '<u2'),
            'places': packed(np.concatenate([np.empty((0, 4)), *places]))}


def _error_plots(known, stamps, poses, kept):
    """Yield the plots of the errors along the drive."""
    for plot, values in _errors(known, stamps, poses):
        yield plot | {'values': packed(_largest(values, kept))}


def _errors(known, stamps, poses, scans=None):
    """Yield plots and errors ``(N,)`` against the truth, or else the relations, or else the wheel odometry.

    `scans` ``(N,)`` are the numbers of the scans if some lack a pose: the next metre does not span such a hole.
    """
    found = None
    if known.truth:
        truth = known.true_poses(stamps).poses
        found = 'Error over the next metre', 'against the truth', _over_a_metre(truth, poses, scans)
    elif known.relations and len(poses):
        first, second, there = related(stamps, known.relations)
        values = errors(relative(poses[first], poses[second]), known.relations.motions[there])
        found = 'Error of relations', 'at the later scan', _of_scans(len(poses), second, values)
    elif known.wheels:
        wheels = interpolate(*known.wheels, stamps)
        found = 'Difference from the wheels over the next metre', '', _over_a_metre(wheels, poses, scans)
    if found is None or not np.isfinite(found[2]).any():
        return
    name, note, values = found
    for what, unit, row in zip(('translation', 'rotation'), ('m', 'deg'), values, strict=True):
        yield {'id': what, 'name': f'{name}: {what}', 'short': f'{what} error', 'note': note, 'unit': unit,
               'log': True}, row


def _over_a_metre(reference, poses, scans):
    """Return errors ``(2, N)`` [m], [deg] of the motion from each scan over the next metre of the `reference`."""
    first, later = apart(reference, METRES, scans)
    values = errors(relative(poses[first], poses[later]), relative(reference[first], reference[later]))
    return _of_scans(len(poses), first, values)


def _of_scans(count, scans, values):
    """Return the largest value of each scan ``(2, count)``; nan for a scan without a value."""
    rows = np.full((2, count), np.nan)
    for row, each in zip(rows, values, strict=True):
        np.fmax.at(row, scans, each)
    return rows


def _largest(values, kept):
    """Return the largest of the `values` ``(N,)`` from each stored scan up to the next stored scan."""
    return np.fmax.reduceat(values, kept) if len(kept) else np.zeros(0)


def _time_plot(milliseconds, kept):
    """Yield the plot of the processing times along the drive."""
    if len(kept) and len(milliseconds):
        times = np.array(milliseconds)
        median, p95 = np.percentile(times, (50, 95))
        yield {'id': 'time', 'name': 'Processing time', 'short': 'processing time', 'unit': 'ms', 'log': True,
               'note': f'median {median:.2f} ms, 95 % below {p95:.2f} ms, longest {times.max():.1f} ms',
               'values': packed(_largest(times, kept))}


def sections(report, most=25) -> list:
    """Return a table of the drive in up to `most` equal sections: from, to, scans, not OK, largest errors and time.

    Each row holds the distance or scan number where the section begins and ends, the number of scans and of those that
    are not OK, and the longest processing time [ms].
    """
    trajectory = report.trajectory
    count = len(trajectory.poses)
    if not count:
        return []
    distance = path_lengths(trajectory.pose_array())
    bad = np.array([status is not Status.OK for status in trajectory.statuses])
    times = trajectory.milliseconds
    edges = np.unique(np.linspace(0, count, min(most, count) + 1).astype(int))
    return [[*rounded([distance[start], distance[end - 1], end - start, bad[start:end].sum()], 2),
             round(max(times[start:end]), 2) if times else None] for start, end in pairwise(edges)]
