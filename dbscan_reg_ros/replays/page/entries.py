# SPDX-License-Identifier: Apache-2.0
"""Entries of the index of several drives: one for each replay, or for each recording of a comparison."""
from pathlib import Path

from ...core.registration.records import Status
from ...evaluation.metrics import path_lengths
from ...figures.plots import density_map
from .drive_data import KINDS, competitor_poses
from .index import DriveEntry, small_map, write_index
from .report import Report, write_report
from .scan_history import ScanHistory

REPLAY_COLUMNS = ['distance [m]', 'time [s]', 'scans', 'not OK', 'drift over 5 m [%]', 'error over 1 m [m]',
                  'position error [m]']
COMPARISON_COLUMNS = ['competitor', 'distance [m]', 'scans', 'not OK', 'error over 1 m [m]', 'error over 1 m [deg]',
                      'verdict']
DRIFT = 5.0
"""Distance [m] of the motion over which the drift is measured."""


def replay_entry(name, folder, measures, density, lines) -> DriveEntry:
    """Return the entry of a replay in the index of several replays.

    Parameters
    ----------
    name : str
        Name of the recording.
    folder : Path
        Folder of the results.
    measures : dict
        Measures of the replay, named as in ``metrics.json``.
    density : DensityMap
    lines : list of (str, str, (N, 2) float [m])
        Kind, name and positions of the trajectories.
    """
    drift = measures.get('rpe_5m_mean_m')
    error = measures.get('rpe_1m_mean_m', measures.get('relations_neighbour_mean_m'))
    not_ok = sum(measures[status.value] for status in Status if status is not Status.OK) + measures['skipped']
    row = [_number(measures.get('driven_m'), 1), _number(measures.get('duration_s'), 1), str(measures['scans']),
           str(not_ok), _number(None if drift is None else 100.0 * drift / DRIFT, 2), _number(error, 4),
           _number(measures.get('ate_m'), 3)]
    return DriveEntry(name, str(Path(folder, 'report.html')), [row], small_map(density, lines))


def write_replay_index(out, entries):
    """Write ``index.html`` into the folder of all results, with links to the page of each replay."""
    linked = [entry._replace(link=str(Path(entry.link).relative_to(out))) for entry in entries]
    write_index(Path(out, 'index.html'), f'{len(entries)} replays', REPLAY_COLUMNS, linked)


def write_comparison_page(path, recording, known, trajectories, names) -> DriveEntry:
    """Write the page of a recording that shows all competitors; return its entry in the index, without table rows.

    Parameters
    ----------
    path : Path
    recording : Recording
    known : KnownMotion
    trajectories : list of Trajectory
        Trajectories of the competitors; the scans are drawn at the poses of the first, A.
    names : list of str
        Names of the competitors.
    """
    ours, history = trajectories[0], ScanHistory()

    def scans():
        for number, scan in enumerate(ours.usable(recording.scans())):
            history.add_scan(number, scan, ours.statuses[number])
            yield scan

    density = density_map(scans(), ours.poses)
    others = list(zip(names[1:], trajectories[1:], strict=True))
    summary = [('recording', str(recording.path)), ('map and scans', names[0]),
               *(('layer', name) for name, _ in others)]
    write_report(path, Report(f'{recording.name}: {len(names)} competitors', summary, known, ours, density, [], None,
                              history=history, competitors=others))
    lines = [('trajectory', names[0], ours.pose_array()[:, :2]),
             *((f'other{place % KINDS}', name, competitor_poses(ours, trajectory)[:, :2])
               for place, (name, trajectory) in enumerate(others))]
    return DriveEntry(recording.name, f'{path.parent.name}/{path.name}', [], small_map(density, lines))


def comparison_row(name, trajectory, errors, verdict) -> list:
    """Return the table row of a competitor; `errors`: mean errors over 1 m of translation [m] and rotation [deg]."""
    driven = path_lengths(trajectory.pose_array())[-1] if trajectory.poses else None
    not_ok = sum(status is not Status.OK for status in trajectory.statuses) + trajectory.used.count(False)
    metres, degrees = errors or (None, None)
    return [name, _number(driven, 1), str(len(trajectory.used)), str(not_ok), _number(metres, 4), _number(degrees, 3),
            verdict]


def _number(value, digits):
    return 'unknown' if value is None else f'{value:.{digits}f}'
