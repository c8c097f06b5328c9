# SPDX-License-Identifier: Apache-2.0
"""Report of a replay: one page that opens in any browser, without a network."""
from dataclasses import dataclass, field
from html import escape
from importlib import resources
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...core.parameters.tree import Parameters
from ...evaluation.known_motion import KnownMotion
from ...figures.plots import DensityMap
from ...recordings.files import replacing
from ..in_map import InMap
from ..trajectory import Trajectory
from .drive_data import drive_data, sections
from .encoding import picture, rounded, script_json
from .scan_history import ScanHistory

SCRIPTS = 'drive.js', 'drawing.js', 'plots.js', 'map_view.js', 'pairs.js', 'page.js', 'start.js'
"""Files with the parts of the script of the page, in their order."""


class ClosedMap(NamedTuple):
    """Result of loop closing.

    Attributes
    ----------
    poses : (N, 3) float
        Corrected poses of the sensor at every scan that was used [m, m, rad].
    pairs : (L, 2) int
        Numbers of the two scans of each loop.
    density : DensityMap
        Map along the corrected poses.
    """

    poses: np.ndarray
    pairs: np.ndarray
    density: DensityMap


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
    parameters : Parameters or None
        Parameters of the odometry; None if another method made the trajectory.
    register : str
        Command that shows a pair of scans once their numbers are appended.
    history : ScanHistory
        Returns, segments, covariance and status of each scan.
    closed : ClosedMap or None
        Result of loop closing; None if loops were not closed.
    in_map : InMap or None
        The drive in the map of a file; None without such a map.
    competitors : list of (str, Trajectory)
        Names and trajectories of the competitors over the same recording.
    index : str
        Address of the index of several drives, relative to the page; empty without an index.
    """

    title: str
    summary: list
    known: KnownMotion
    trajectory: Trajectory
    density: DensityMap
    pairs: list
    parameters: Parameters | None
    register: str = ''
    history: ScanHistory = field(default_factory=ScanHistory)
    closed: ClosedMap | None = None
    in_map: InMap | None = None
    competitors: list = field(default_factory=list)
    index: str = ''


def write_report(path: Path, report: Report) -> None:
    """Write the page of a replay to `path`."""
    data, scans = page_data(report)
    link = f'<nav><a href="{escape(report.index)}">All drives</a></nav>' if report.index else ''
    with replacing(path) as file:
        for part in page_parts({'data': script_json(data), 'scans': scans, 'connect': '', 'index': link}):
            file.write(part)


def page_parts(contents, template='report.html', scripts=SCRIPTS):
    """Yield the parts of a page: the template with style, script and `contents` (name -> text) inserted."""
    folder = resources.files(__package__)
    contents = contents | {'style': folder.joinpath('style.css').read_text(encoding='utf-8'),
                           'script': ''.join(folder.joinpath(name).read_text(encoding='utf-8') for name in scripts)}
    before, *rest = folder.joinpath(template).read_text(encoding='utf-8').split('{{')
    yield before
    for part in rest:
        name, _, after = part.partition('}}')
        yield contents[name]
        yield after


def page_data(report, live=False):
    """Return the data that the script of the page reads, as numbers and texts, and the packed scans."""
    drive = drive_data(report)
    packed_scans = drive.pop('scans')
    scans = report.trajectory.used_numbers
    data = {
        'title': report.title, 'live': live, 'summary': report.summary, 'drive': drive,
        'map': _map(report.density), 'closedMap': _map(report.closed.density) if report.closed else None,
        'knownMap': _map(report.in_map.picture()) if report.in_map else None,
        'nothing': '' if any(plot['id'] == 'translation' for plot in drive['plots']) else _nothing(report.known),
        'pairs': [_pair_data(pair, scans) for pair in report.pairs],
        'register': report.register, 'sections': sections(report),
        'parameters': list(_parameters(report.parameters)) if report.parameters else [],
    }
    return data, packed_scans


def _map(density):
    return {'image': picture(density.ink), 'extent': rounded(density.extent)}


def _pair_data(pair, scans):
    """Return the data of a `PairToReview` for the page; ``scans[n]``: number in the recording of the n-th used scan."""
    return {'number': pair.number, 'scan': int(scans[pair.number]), 'on': int(scans[pair.reference_number]),
            'status': pair.status.value, 'reason': pair.reason, 'overlap': round(float(pair.overlap), 3),
            'reference': rounded(pair.reference.T), 'current': rounded(pair.current.T),
            'lines': [rounded(lines.reshape(-1, 4)) for lines in (pair.reference_lines, pair.current_lines)]}


def _nothing(known):
    """Explain in a sentence why the page shows no errors."""
    if known.truth or known.relations or known.wheels:
        return 'No part of the trajectory is long enough for a comparison with the known motion.'
    return 'The true motion is unknown.'


def _parameters(parameters):
    values = parameters.flatten()
    for d in parameters.descriptions():
        value = values[d.name]
        yield {'name': d.name, 'value': _text(value), 'default': _text(d.default), 'unit': d.unit, 'help': d.help,
               'changed': value != d.default}


def _text(value):
    return str(list(value) if isinstance(value, tuple) else value)
