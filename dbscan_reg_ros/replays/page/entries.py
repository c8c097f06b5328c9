# SPDX-License-Identifier: Apache-2.0
"""Entries of the index of several drives: one for each replay, or for each recording of a comparison."""
from pathlib import Path

from ...core.registration.records import Status
from ...evaluation.comparison import ALIKE
from ...evaluation.competitor_results import ERRORS, grouped_notes, number
from ...figures.plots import density_map
from .drive_data import competitor_lines
from .index import Columns, DriveEntry, SmallMap, small_map, write_index
from .report import Report, write_report
from .scan_history import ScanHistory

REPLAY_COLUMNS = Columns(
    ['recording', 'distance [m]', 'time [s]', 'scans', 'not OK', 'drift over 5 m [%]', 'error over 1 m [m]',
     'position error [m]'],
    'Not OK: scans with another status than OK, and scans that could not be used. Drift: mean error of the translation '
    'over 5 m of the true path, in percent of the 5 m. Position error: root mean square after alignment with the '
    'truth.')
COMPARISON_COLUMNS = Columns(
    ['competitor', 'against A', *(f'{name} [{unit}]' for name, unit, _ in ERRORS), 'distance [m]', 'with a pose',
     'not OK'],
    'Not OK: scans with another status than OK, or without a pose. With a pose: n + k of all scans, if k '
    'poses are interpolated. Error over 1 m, 5 m: mean error of the motion from each scan to the first scan at least '
    '1 m, 5 m farther along the true path, over the scans with poses of both A and the competitor. '
    'APE and RPE: root mean squares of the absolute and the relative pose errors over all poses of a competitor, as '
    'evo computes them. '
    'Better or worse: with a confidence of 95 % for translation and rotation together. Not decided: the confidence '
    f'interval of the difference contains 0 and more than {100.0 * ALIKE:.0f} % of the larger error.')
DRIFT = 5.0
"""Distance [m] of the motion over which the drift is measured."""


def replay_entry(name, folder, measures, density, lines) -> DriveEntry:
    """Return the entry of a replay with its results in `folder`, in the index of several replays.

    `measures` are those of ``metrics.json``, `lines` kind, name and positions ``(N, 2)`` [m] of the trajectories.
    """
    drift = measures.get('rpe_5m_mean_m')
    error = measures.get('rpe_1m_mean_m', measures.get('relations_neighbour_mean_m'))
    not_ok = sum(measures[status.value] for status in Status if status is not Status.OK) + measures['skipped']
    row = [number(measures.get('driven_m'), 1), number(measures.get('duration_s'), 1), str(measures['scans']),
           str(not_ok), number(None if drift is None else 100.0 * drift / DRIFT, 2), number(error, 4),
           number(measures.get('ate_m'), 3)]
    return DriveEntry(name, str(Path(folder, 'report.html')), [row], small_map(density, lines))


def write_replay_index(out, entries):
    """Write ``index.html`` into the folder of all results, with links to the page of each replay."""
    linked = [entry._replace(link=str(Path(entry.link).relative_to(out))) for entry in entries]
    write_index(Path(out, 'index.html'), f'{len(entries)} replays', REPLAY_COLUMNS, linked)


def write_comparison_page(path, recording, known, trajectories, names) -> SmallMap:
    """Write the page of a recording that shows all competitors; return its map for the index.

    The scans are drawn at the poses of the first of the `trajectories`, A.
    """
    ours, history = trajectories[0], ScanHistory()

    def scans():
        for place, scan in enumerate(ours.usable(recording.scans())):
            history.add_scan(place, scan, ours.statuses[place])
            yield scan

    density = density_map(scans(), ours.poses)
    others = list(zip(names[1:], trajectories[1:], strict=True))
    summary = [('recording', str(recording.path)), ('map and scans', names[0]),
               *(('layer', name) for name, _ in others),
               *([('true poses', known.true_poses(ours.stamps).explanation)] if known.truth else [])]
    write_report(path, Report(f'{recording.name}: {len(names)} competitors', summary, known, ours, density, [], None,
                              history=history, competitors=others, index='../index.html'))
    lines = [('trajectory', names[0], ours.pose_array()[:, :2]), *competitor_lines(ours, others)]
    return small_map(density, lines)


def comparison_entry(link, small, results) -> DriveEntry:
    """Return the entry of a recording in the index of a comparison; `link` is the address of its page."""
    rows = [[f'{each.letter}: {each.name}', each.verdict, *each.errors(), number(each.driven, 1), each.with_pose,
             str(each.not_ok)] for each in results]
    return DriveEntry(results[0].recording, link, rows, small, grouped_notes(results))
