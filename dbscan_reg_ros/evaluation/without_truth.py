# SPDX-License-Identifier: Apache-2.0
"""Comparison of trajectories whose true motion is unknown: their ends, measures of their maps, differences."""
from dataclasses import asdict, dataclass

import numpy as np

from ..recordings.poses import compose, relative
from .metrics import apart, errors, final_error, path_lengths

CELL = 0.05
"""Side of the cells of the map in which returns are counted [m]."""
MOST_RETURNS = 3_000_000
"""Of longer recordings every n-th scan is used for the map, so that it has about this number of returns."""
METRES = 1.0
"""Distance along the path of A over which motions are compared [m]."""
COLUMNS = ('driven', 'end [m]', 'end [deg]', 'returns a cell', '1 m [m]', '1 m [deg]', 'at end [m]', 'at end [deg]')
LEGEND = (f'the true motion is unknown, so there is no verdict; driven: path [m]; end: motion from the first to the '
          f'last pose; returns a cell: in an occupied cell of {CELL:g} m of the map, more in a sharper map; then the '
          f'mean difference from A over {METRES:g} m and that of the motion from the first to the last common pose')


@dataclass(frozen=True)
class Unjudged:
    """Measures of a trajectory without truth, in the order of `COLUMNS`; None where they cannot be computed."""

    driven: float | None = None
    end_m: float | None = None
    end_deg: float | None = None
    returns_per_cell: float | None = None
    difference_m: float | None = None
    difference_deg: float | None = None
    end_difference_m: float | None = None
    end_difference_deg: float | None = None

    def texts(self) -> list:
        """Return the measures as texts."""
        return ['unknown' if value is None else f'{value:.3f}' for value in asdict(self).values()]

    @property
    def note(self) -> str:
        """The measures in one line."""
        return 'without truth: ' + ', '.join(map(' '.join, zip(COLUMNS, self.texts(), strict=True)))


def measures_without_truth(recording, trajectories) -> list:
    """Return the `Unjudged` of each trajectory over the scans of a recording; differences are those from the first."""
    sharp = _returns_per_cell(recording, trajectories)
    return [Unjudged(**_ends(each), returns_per_cell=returns_per_cell, **_differences(trajectories[0], each))
            for each, returns_per_cell in zip(trajectories, sharp, strict=True)]


def _ends(trajectory) -> dict:
    poses = trajectory.pose_array()
    if not len(poses):
        return {}
    metres, degrees = errors(relative(poses[:1], poses[-1:]), np.zeros((1, 3)))
    return {'driven': float(path_lengths(poses)[-1]), 'end_m': float(metres[0]), 'end_deg': float(degrees[0])}


def _differences(a, b) -> dict:
    """Return the differences of two trajectories at their common scans."""
    both = _used(a) & _used(b)
    if not both.any():
        return {}
    first, second = (each.pose_array()[both[_used(each)]] for each in (a, b))
    end = final_error(second, first)
    found = {'end_difference_m': end['final_m'], 'end_difference_deg': end['final_deg']}
    start, later = apart(first, METRES, np.flatnonzero(both))
    if len(start):
        metres, degrees = errors(relative(second[start], second[later]), relative(first[start], first[later]))
        found |= {'difference_m': float(metres.mean()), 'difference_deg': float(degrees.mean())}
    return found


def _returns_per_cell(recording, trajectories) -> list:
    """Return the mean number of returns in the occupied cells of the map of each trajectory, of their common scans."""
    common = np.logical_and.reduce([_used(each) for each in trajectories])
    rows = [np.cumsum(_used(each)) - 1 for each in trajectories]
    poses = [each.pose_array() for each in trajectories]
    cells: list[list] = [[] for _ in trajectories]
    count, step = 0, 1
    for number, scan in enumerate(recording.scans()):
        if number == 0:
            step = -(-len(common) * scan.geometry.size // MOST_RETURNS)
        if number >= len(common) or not common[number] or number % step:
            continue
        points = scan.points[scan.valid]
        count += len(points)
        for place, (row, own) in enumerate(zip(rows, poses, strict=True)):
            laid = compose(own[row[number]][None].repeat(len(points), axis=0),
                           np.column_stack((points, np.zeros(len(points)))))[:, :2]
            cells[place].append(np.floor(laid / CELL).astype(np.int64) @ (1, 1 << 32))
    return [count / len(np.unique(np.concatenate(each))) if count else None for each in cells]


def _used(trajectory):
    return np.array(trajectory.used, dtype=bool)


def describe_unjudged(recording, names, found) -> str:
    """Format the `Unjudged` of the competitors with these `names` on a recording as a table."""
    wide = max(len('competitor'), *map(len, names))
    lines = [f'{recording}: {"competitor":{wide}}' + ''.join(f'  {each:>14}' for each in COLUMNS)]
    lines += [f'{"":{len(recording) + 1}} {name:{wide}}' + ''.join(f'  {each:>14}' for each in row.texts())
              for name, row in zip(names, found, strict=True)]
    return '\n'.join([*lines, LEGEND])
