# SPDX-License-Identifier: Apache-2.0
"""Table of a comparison: the errors of each competitor on each recording, and notes on missing errors."""
import csv
import io
from dataclasses import asdict, dataclass
from itertools import groupby
from operator import attrgetter

import numpy as np

from ..core.registration.records import Status
from ..recordings import read_tum, write_tum
from .comparison import FARTHER_METRES, METRES, TooShort, mean_errors, motions_over, paired
from .evo_measures import EvoMeasures, evo_measures
from .metrics import path_lengths
from .sensor_offset import hint

UNKNOWN = 'unknown'
"""Printed instead of a number that cannot be computed."""
DEFINITION = (f'error over {METRES:g} m, {FARTHER_METRES:g} m: mean error of the motion from each scan to the first '
              f'scan at least {METRES:g} m, {FARTHER_METRES:g} m farther along the true path; all columns: '
              'doc/faq.md, "Comparing methods"')
"""Printed below the table."""
ERRORS = (('error over 1 m', 'm', 4), ('error over 1 m', 'deg', 3), ('error over 5 m', 'm', 4),
          ('error over 5 m', 'deg', 3), ('APE rmse', 'm', 6), ('RPE rmse', 'm', 6), ('RPE rmse', 'deg', 6))
"""Name, unit and digits of each error of a competitor."""
TEX = {'\\': r'\textbackslash{}', '~': r'\textasciitilde{}', '^': r'\textasciicircum{}',
       **{character: f'\\{character}' for character in '&%$#_{}'}}
"""Characters that LaTeX takes as commands -> how they are written."""


@dataclass(frozen=True)
class CompetitorResult:
    """Result of a competitor on a recording."""

    recording: str
    letter: str
    name: str
    scans: int
    poses: int
    interpolated: int
    not_ok: int
    """Numbers of scans: all, those with a pose, those whose pose is interpolated, and those without a pose or with
    another status than `OK`."""
    driven: float | None
    """Path length over all poses [m]."""
    error_m: float | None
    error_deg: float | None
    """Mean errors of the motion over 1 m on the scans with poses of both A and the competitor; None if unknown."""
    error_5m_m: float | None
    error_5m_deg: float | None
    """The same over 5 m."""
    evo: EvoMeasures
    """Measures over all poses of the competitor."""
    verdict: str
    """Whether the competitor is better or worse than A; empty for A."""
    notes: list[str]
    """Which scans have a pose, and why measures are missing."""

    @property
    def with_pose(self) -> str:
        """How many scans have a pose, such as ``600 of 600``, or ``563 + 37 of 600`` with 37 interpolated poses."""
        interpolated = f' + {self.interpolated}' if self.interpolated else ''
        return f'{self.poses - self.interpolated}{interpolated} of {self.scans}'

    def as_json(self) -> dict:
        """Return a dictionary of all values by name, including the measures in `evo`."""
        values = asdict(self)
        evo = values.pop('evo')
        return values | {name: evo[name] for name in ('ape_m', 'rpe_m', 'rpe_deg')}

    def errors(self) -> list[str]:
        """Return the errors as texts, in the order of `ERRORS`; `UNKNOWN` for those that cannot be computed."""
        return [number(value, digits) for value, (_, _, digits) in zip(
            (self.error_m, self.error_deg, self.error_5m_m, self.error_5m_deg, self.evo.ape_m, self.evo.rpe_m,
             self.evo.rpe_deg), ERRORS, strict=True)]


def _unused(problems) -> list:
    """Summarise why scans were not used."""
    others = f', and {len(problems) - 1} more' if len(problems) > 1 else ''
    return [f'{problems[0]}{others}'] if problems else []


def number(value, digits) -> str:
    """Format a number, or `UNKNOWN` for None."""
    return UNKNOWN if value is None else f'{value:.{digits}f}'


def describe(results) -> list:
    """Format the results of all competitors as the lines of a table, followed by their notes."""
    wide = max(len('recording'), *(len(each.recording) for each in results))
    named = max(len('competitor'), *(len(each.name) + 2 for each in results))
    indent = ' ' * (wide + named + 4)
    counted = max(14, *(len(each.with_pose) for each in results))
    over = f'{"error over 1 m":>18}  {"error over 5 m":>18}'
    lines = [f'{indent}{"scans with":>{counted}}  {over}  {"APE rmse":>11}  {"RPE rmse over 1 m":>23}',
             f'{"recording":{wide}}  {"competitor":{named}}  {"a pose":>{counted}}  {"[m]":>9} {"[deg]":>8}  '
             f'{"[m]":>9} {"[deg]":>8}  {"[m]":>11}  {"[m]":>11} {"[deg]":>11}  against A']
    for each in results:
        m, deg, m_5, deg_5, ape, rpe_m, rpe_deg = each.errors()
        lines.append(f'{each.recording:{wide}}  {f"{each.letter} {each.name}":{named}}  {each.with_pose:>{counted}}  '
                     f'{m:>9} {deg:>8}  {m_5:>9} {deg_5:>8}  {ape:>11}  {rpe_m:>11} {rpe_deg:>11}  '
                     f'{each.verdict}'.rstrip())
    lines.append(DEFINITION)
    if len({each.poses for each in results if each.recording == results[0].recording}) > 1:
        lines.append('APE and RPE are over all poses of each trajectory: rows with other scans are not comparable')
    if any(each.interpolated for each in results):
        lines.append('scans with a pose: "n + k": n with a pose at their stamp, k with an interpolated pose')
    notes = [(recording, note) for recording, group in groupby(results, attrgetter('recording'))
             for note in grouped_notes(list(group))]
    return lines + [f'{recording}, {note}' for recording, note in notes]


def csv_table(results) -> str:
    """Format the results as comma-separated values, with the names of `CompetitorResult.as_json`."""
    text = io.StringIO()
    rows = [each.as_json() | {'notes': '; '.join(each.notes)} for each in results]
    writer = csv.DictWriter(text, rows[0], lineterminator='\n')
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def latex_table(results) -> str:
    """Format the errors as a ``tabular`` of LaTeX; a dash stands for what is unknown."""
    rows = [['recording', 'competitor', *(f'{name} [{unit}]' for name, unit, _ in ERRORS), 'against A']]
    rows += [[each.recording, f'{each.letter} {each.name}', *(text.replace(UNKNOWN, '--') for text in each.errors()),
              each.verdict] for each in results]
    lines = [' & '.join(''.join(TEX.get(character, character) for character in text) for text in row) + r' \\'
             for row in rows]
    lines[0] += r' \hline'
    return '\n'.join([rf'\begin{{tabular}}{{ll{"r" * len(ERRORS)}l}}', *lines, r'\end{tabular}', ''])


def grouped_notes(results) -> list:
    """Return the notes of the results of one recording, each once, after the letters of the competitors."""
    letters = {note: ', '.join(each.letter for each in results if note in each.notes)
               for result in results for note in result.notes}
    return [f'{those}: {note}' for note, those in letters.items()]


def results_of(recording, folder, known, trajectories, comparisons) -> list:
    """Return the `CompetitorResult` of each competitor on the recording with this name in the `comparisons` with A.

    The `trajectories` begin with that of A. To `folder` the files are written from which the measures of evo are
    computed.
    """
    verdicts = ['', *(comparison.verdict(recording) for comparison in comparisons)]
    means = [_mean_errors(known, trajectories[0]),
             *([d.b for d in comparison.table.get(recording, ())] for comparison in comparisons)]
    names = [('A', comparisons[0].a), *((comparison.letter, comparison.b) for comparison in comparisons)]
    results = []
    for (letter, name), trajectory, mean, verdict in zip(names, trajectories, means, verdicts, strict=True):
        evo, poses = _measured(folder, letter, trajectory, known), trajectory.pose_array()
        metres, degrees = mean or (None, None)
        farther = mean_errors(known, trajectories[0], trajectory, FARTHER_METRES)
        far_metres, far_degrees = farther or (None, None)
        ok = sum(status is Status.OK for status in trajectory.statuses)
        notes = [*_given(known, trajectory), *_unused(trajectory.problems),
                 *([] if farther else [_no_farther_error(known)]), *evo.reasons]
        results.append(CompetitorResult(
            recording, letter, name, len(trajectory.used), len(poses), trajectory.interpolated,
            len(trajectory.used) - ok, float(path_lengths(poses)[-1]) if len(poses) else None, metres, degrees,
            far_metres, far_degrees, evo, verdict, notes))
    return results


def _given(known, trajectory) -> list:
    """Return notes on the trajectory of another program: which scans have a pose, and a hint to name the sensor's."""
    if not trajectory.explanation:
        return []
    motions = motions_over(known, trajectory, trajectory, METRES)
    return [trajectory.explanation, *filter(None, [hint(*motions) if len(motions[0]) else ''])]


def _no_farther_error(known) -> str:
    """Return why there is no error over `FARTHER_METRES`."""
    reason = (f'no two scans with a pose are {FARTHER_METRES:g} m apart along the true path' if known.truth else
              _no_poses(known))
    return f'no error over {FARTHER_METRES:g} m: {reason}'


def _no_poses(known) -> str:
    return ('the recording has no true poses, only relations between scans' if known.relations else
            'the true motion is unknown')


def _mean_errors(known, trajectory) -> list:
    """Return the mean errors over 1 m of a trajectory, translation [m] and rotation [deg]; empty if unknown."""
    try:
        return paired(known, trajectory, trajectory).a.mean(axis=1).tolist() if known.is_known else []
    except TooShort:
        return []


def _measured(folder, letter, trajectory, known) -> EvoMeasures:
    """Compute the `EvoMeasures` of the files ``LETTER.tum`` and ``truth_of_LETTER.tum``, which are written here."""
    if known.truth is None:
        return EvoMeasures(None, None, None, [f'no APE and no RPE: {_no_poses(known)}'])
    stamps, first = np.unique(np.array(trajectory.stamps, dtype=np.int64), return_index=True)
    reference, explanation, _ = known.true_poses(stamps)
    there = np.isfinite(reference).all(axis=1)
    files = folder / f'{letter}.tum', folder / f'truth_of_{letter}.tum'
    for file, content in zip(files, (trajectory.pose_array()[first], reference), strict=True):
        write_tum(file, stamps[there], content[there])
    found = evo_measures(*(read_tum(file)[1] for file in files))
    if not there.all():
        found.reasons.insert(0, f'true poses: {explanation}')
    return found
