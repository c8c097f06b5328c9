# SPDX-License-Identifier: Apache-2.0
"""A replay as one page that opens in any browser, without a network."""
import base64
import io
import json
from importlib import resources

import numpy as np

from ..core.registration.records import Status
from ..evaluation.known_motion import KnownMotion
from ..evaluation.metrics import align, apart, errors, path_lengths, related
from ..figures.plots import DensityMap
from ..recordings import interpolate
from ..recordings.files import replacing
from ..recordings.poses import compose, relative

BARS = 40
DRIVE = 1.0
"""Where the sensor moved less than this [m] all is shown over the scans instead of the distance."""
LEVELS = [status.value for status in Status]


def write_report(path, title, summary, known: KnownMotion, track, density: DensityMap, spots, parameters, register=''):
    """Write the page.

    Parameters
    ----------
    path : Path
    title : str
    summary : list of (str, str)
        What stands at the top.
    known : KnownMotion
        What the track is set against.
    track : Track
    density : DensityMap
        Of the track.
    spots : list of Spot
    parameters : Parameters
    register : str
        The command that shows a pair once the numbers of its scans are added.
    """
    poses = track.pose_array()
    distance = path_lengths(poses) if len(poses) else np.zeros(0)
    scans = np.flatnonzero(track.used)
    moved = not len(distance) or distance[-1] >= DRIVE
    along = distance if moved else scans.astype(float)
    data = {
        'title': title, 'summary': summary,
        'along': {'label': 'distance driven [m]' if moved else 'scan', 'end': max(along.max(initial=0.0), 1.0), 'at': _rounded(along)},
        'map': {'image': _picture(density.ink), 'extent': _rounded(density.extent)},
        'track': {'x': _rounded(poses[:, 0]), 'y': _rounded(poses[:, 1]), 'distance': _rounded(distance),
                  'status': [LEVELS.index(status.value) for status in track.statuses]},
        'statusNames': LEVELS,
        'others': list(_others(known, track.stamps, poses)),
        'errors': _errors(known, track.stamps, poses, along),
        'nothing': _nothing(known),
        'spots': [{'number': spot.number, 'scan': int(scans[spot.number]), 'on': int(scans[spot.reference_number]),
                   'status': spot.status.value, 'reason': spot.reason, 'overlap': round(float(spot.overlap), 3),
                   'reference': _rounded(spot.reference.T), 'current': _rounded(spot.current.T),
                   'lines': [_rounded(lines.reshape(-1, 4)) for lines in (spot.reference_lines, spot.current_lines)]}
                  for spot in spots],
        'register': register,
        'times': _times(np.array(track.milliseconds)),
        'parameters': list(_parameters(parameters)),
    }
    page = resources.files(__package__).joinpath('report.html').read_text(encoding='utf-8')
    text = json.dumps(data, separators=(',', ':'), allow_nan=False).replace('<', '\\u003c')
    with replacing(path) as file:
        file.write(page.replace('{{data}}', text))


def _picture(ink):
    """A grey picture of ``(rows, columns)`` shares of ink, as an address that holds it."""
    from matplotlib.image import imsave

    file = io.BytesIO()
    imsave(file, ink, cmap='gray_r', vmin=0.0, vmax=1.0, origin='lower', format='png')
    return 'data:image/png;base64,' + base64.b64encode(file.getvalue()).decode()


def _rounded(values):
    return np.round(values, 3).tolist()


def _others(known, stamps, poses):
    """The other ways of the sensor or robot that are known, where they lie in the frame of the track."""
    for kind, name, trajectory in (('truth', 'truth', known.truth), ('wheels', 'wheel odometry', known.wheels)):
        if trajectory is None:
            continue
        way = interpolate(*trajectory, stamps)
        there = np.isfinite(way).all(axis=1)
        if there.sum() < 2:
            continue
        way, track = way[there], poses[there]
        if kind == 'truth':
            way = align(way, track)
        else:
            way = compose(np.broadcast_to(track[0], way.shape), relative(np.broadcast_to(way[0], way.shape), way))
        yield {'kind': kind, 'name': name, 'x': _rounded(way[:, 0]), 'y': _rounded(way[:, 1])}


def _nothing(known):
    """Why there are no errors, where there are none."""
    if known.truth or known.relations or known.wheels:
        return 'No part of the way is long enough to be set against what is known of it.'
    return 'Nothing is known of the true motion.'


def _errors(known, stamps, poses, along):
    """Errors along the way: by the truth, else by relations, else as the difference from the wheels."""
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
                    + (f'; {beyond} beyond the picture.' if beyond else '.'),
            'marks': [['median', round(float(median), 3)], ['95 %', round(float(p95), 3)]]}


def _parameters(parameters):
    values = parameters.flatten()
    for d in parameters.describe():
        value = values[d.name]
        yield {'name': d.name, 'value': _text(value), 'default': _text(d.default), 'unit': d.unit, 'help': d.help,
               'changed': value != d.default}


def _text(value):
    return str(list(value) if isinstance(value, tuple) else value)
