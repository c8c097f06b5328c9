# SPDX-License-Identifier: Apache-2.0
"""Page of a running node: the page of a replay without scans; events from the server add the scans of the drive."""
from ...evaluation.known_motion import KnownMotion
from ...figures.plots import density_map
from ..trajectory import Trajectory
from .encoding import script_json
from .report import Report, page_data, page_parts

LEVELS = 'ok', 'warning', 'error', 'stale'
"""Levels of a report on ``/diagnostics``."""
SCRIPTS = 'drive.js', 'drawing.js', 'plots.js', 'map_view.js', 'pairs.js', 'page.js', 'live.js'


def live_page(title: str) -> bytes:
    """Return the HTML text of the page of a running node."""
    report = Report(title, [], KnownMotion(None, None, None), Trajectory(), density_map([], []), [], None)
    data, scans = page_data(report, live=True)
    data['drive']['statusNames'] = LEVELS
    data['drive']['along'] = {'label': 'time [s]', 'unit': 's', 'end': 1.0, 'at': ''}
    data['drive']['plots'] = [{'id': 'speed', 'name': 'Speed', 'short': 'speed', 'note': '',
                               'unit': 'm/s', 'log': False, 'values': ''}]
    data['nothing'] = ''
    contents = {'data': script_json(data), 'scans': scans, 'connect': "; connect-src 'self'", 'index': ''}
    return ''.join(page_parts(contents, scripts=SCRIPTS)).encode()
