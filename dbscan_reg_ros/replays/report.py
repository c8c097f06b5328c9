# SPDX-License-Identifier: Apache-2.0
"""Report of a replay: one page that opens in any browser, without a network."""
import base64
import io
import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from ..core.parameters.tree import Parameters
from ..core.registration.records import Status
from ..evaluation.known_motion import KnownMotion
from ..evaluation.metrics import align, apart, errors, path_lengths, related
from ..figures.plots import DensityMap
from ..recordings import interpolate
from ..recordings.files import replacing
from ..recordings.poses import compose, relative
from .trajectory import Trajectory

BARS = 40
DRIVE = 1.0
"""Below this distance [m] the charts have the scan number on their axis instead of the distance."""
LEVELS = [status.value for status in Status]


@dataclass(frozen=True, eq=False)
class Report:
    """What the page of a replay shows.

    Attributes
    ----------
    title : str
    summary : list of (str, str)
        Name and text of each line at the top.
    known : KnownMotion
        Truth, relations and wheel odometry that the trajectory is compared with.
    trajectory : Trajectory
    density : DensityMap
        Map along the trajectory.
    pairs : list of PairToReview
    parameters : Parameters
    register : str
        Command that shows a pair of scans once their numbers are appended.
    """

    title: str
    summary: list
    known: KnownMotion
    trajectory: Trajectory
    density: DensityMap
    pairs: list
    parameters: Parameters
    register: str = ''


def write_report(path: Path, report: Report) -> None:
    """Write the page of a replay to `path`."""
    with replacing(path) as file:
        page = resources.files(__package__).joinpath('report.html').read_text(encoding='utf-8')
        text = json.dumps(_page_data(report), separators=(',', ':'), allow_nan=False).replace('<', '\\u003c')
        file.write(page.replace('{{data}}', text))


def _page_data(report):
    """Collect what the script of the page reads, as plain numbers and texts."""
    trajectory, known = report.trajectory, report.known
    poses = trajectory.pose_array()
    distance = path_lengths(poses) if len(poses) else np.zeros(0)
    scans = np.flatnonzero(trajectory.used)
    moved = not len(distance) or distance[-1] >= DRIVE
    along = distance if moved else scans.astype(float)
    return {
        'title': report.title, 'summary': report.summary,
        'along': {'label': 'distance driven [m]' if moved else 'scan', 'end': max(along.max(initial=0.0), 1.0),
                  'at': _rounded(along)},
        'map': {'image': _picture(report.density.ink), 'extent': _rounded(report.density.extent)},
        'trajectory': {'x': _rounded(poses[:, 0]), 'y': _rounded(poses[:, 1]), 'distance': _rounded(distance),
                       'status': [LEVELS.index(status.value) for status in trajectory.statuses]},
        'statusNames': LEVELS,
        'others': list(_others(known, trajectory.stamps, poses)),
        'errors': _errors(known, trajectory.stamps, poses, along),
        'nothing': _nothing(known),
        'pairs': [_pair_data(pair, scans) for pair in report.pairs],
        'register': report.register,
        'times': _times(np.array(trajectory.milliseconds)),
        'parameters': list(_parameters(report.parameters)),
    }


def _pair_data(pair, scans):
    """Describe a pair to review; `scans` are the numbers, in the recording, of the scans that were used."""
    return {'number': pair.number, 'scan': int(scans[pair.number]), 'on': int(scans[pair.reference_number]),
            'status': pair.status.value, 'reason': pair.reason, 'overlap': round(float(pair.overlap), 3),
            'reference': _rounded(pair.reference.T), 'current': _rounded(pair.current.T),
            'lines': [_rounded(lines.reshape(-1, 4)) for lines in (pair.reference_lines, pair.current_lines)]}


def _picture(ink):
    """Encode a ``(rows, columns)`` array of grey levels, 0..1, as a data URL."""
    from matplotlib.image import imsave

    file = io.BytesIO()
    imsave(file, ink, cmap='gray_r', vmin=0.0, vmax=1.0, origin='lower', format='png')
    return 'data:image/png;base64,' + base64.b64encode(file.getvalue()).decode()


def _rounded(values):
    return np.round(values, 3).tolist()


def _others(known, stamps, poses):
    """Yield the known trajectories of the sensor or robot, moved into the frame of the odometry's trajectory."""
    for kind, name, other in (('truth', 'truth', known.truth), ('wheels', 'wheel odometry', known.wheels)):
        if other is None:
            continue
        path = interpolate(*other, stamps)
        there = np.isfinite(path).all(axis=1)
        if np.count_nonzero(there) <= 1:
            continue
        path, ours = path[there], poses[there]
        if kind == 'truth':
            path = align(path, ours)
        else:
            path = compose(np.broadcast_to(ours[0], path.shape), relative(np.broadcast_to(path[0], path.shape), path))
        yield {'kind': kind, 'name': name, 'x': _rounded(path[:, 0]), 'y': _rounded(path[:, 1])}


def _nothing(known):
    """Say why the page shows no errors."""
    if known.truth or known.relations or known.wheels:
        return 'No part of the trajectory is long enough for a comparison with the known motion.'
    return 'The true motion is unknown.'


def _errors(known, stamps, poses, along):
    """Return the errors along the trajectory: by the truth, else by relations, else the difference from the wheels."""
    if known.truth:
        return _over_a_metre(known.truth, stamps, poses, along,
                             'Error of the motion over the next metre, against the truth', 'error')
    if known.relations and len(poses):
        first, second, found = related(stamps, known.relations)
        values = errors(relative(poses[first], poses[second]), known.relations.motions[found])
        return _panels(along[second], values, 'Error of the motion between related scans, at the later one', 'error')
    if known.wheels:
        return _over_a_metre(known.wheels, stamps, poses, along,
                             'Difference of the motion over the next metre from the wheel odometry', 'difference')
    return []


def _over_a_metre(trajectory, stamps, poses, along, note, word):
    reference = interpolate(*trajectory, stamps)
    there = np.isfinite(reference).all(axis=1)
    poses, along, reference = poses[there], along[there], reference[there]
    scans, later = apart(reference, 1.0) if len(reference) else ([], [])
    if not len(scans):
        return []
    values = errors(relative(poses[scans], poses[later]), relative(reference[scans], reference[later]))
    return _panels(along[scans], values, note, word)


def _panels(along, values, note, word):
    return [{'note': f'{note}: {what}.', 'label': f'{word} [{unit}]', 'at': _rounded(along),
             'value': np.round(value, 5).tolist()}
            for what, unit, value in zip(('translation', 'rotation'), ('m', 'deg'), values, strict=True)]


def _times(milliseconds):
    if not len(milliseconds):
        return {'edges': [0.0, 1.0], 'counts': [0], 'note': 'No scan could be used.', 'marks': []}
    median, p95, most = np.percentile(milliseconds, (50, 95, 99.5))
    shown = milliseconds[milliseconds <= most]
    counts, edges = np.histogram(shown, BARS, range=(0.0, float(most)))
    beyond = len(milliseconds) - len(shown)
    return {'edges': _rounded(edges), 'counts': counts.tolist(),
            'note': f'Median {median:.2f} ms, 95 % below {p95:.2f} ms, longest {milliseconds.max():.1f} ms'
                    + (f'; {beyond} beyond the chart.' if beyond else '.'),
            'marks': [['median', round(float(median), 3)], ['95 %', round(float(p95), 3)]]}


def _parameters(parameters):
    values = parameters.flatten()
    for d in parameters.describe():
        value = values[d.name]
        yield {'name': d.name, 'value': _text(value), 'default': _text(d.default), 'unit': d.unit, 'help': d.help,
               'changed': value != d.default}


def _text(value):
    return str(list(value) if isinstance(value, tuple) else value)
