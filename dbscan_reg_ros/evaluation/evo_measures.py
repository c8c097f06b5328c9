# SPDX-License-Identifier: Apache-2.0
"""Error measures of trajectories as the commands of evo compute and name them (``evo_ape``, ``evo_rpe``).

evo has the GPL licence: nothing of it is imported or copied. A test compares the results with those of its commands.
"""
from dataclasses import dataclass

import numpy as np

from ..recordings.poses import relative
from .metrics import errors

DELTA = 1.0
"""Path length between the two poses of a pair [m], as with ``--delta 1 --delta_unit m`` of ``evo_rpe``."""
TOLERANCE = 0.1
"""Pairs whose path differs from `DELTA` by more than this fraction are left out."""


@dataclass(frozen=True)
class EvoMeasures:
    """Measures of a trajectory; a measure is None if it cannot be computed."""

    ape_m: float | None
    """Root mean square of the absolute position error after alignment [m]."""
    rpe_m: float | None
    rpe_deg: float | None
    """Root mean squares of the relative pose errors over `DELTA`: translation [m], rotation [deg]."""
    reasons: list[str]
    """Why measures are missing."""


def evo_measures(poses, reference) -> EvoMeasures:
    """Return the measures that can be computed for `poses` and a `reference` at the same stamps, both ``(N, 3)``."""
    if len(poses) <= 1:
        return EvoMeasures(None, None, None, [
            f'no APE and no RPE: {len(poses) or "none"} of the estimated poses lies within the time of the true poses'])
    ape, rpe, reasons = ape_rmse(poses, reference), rpe_rmse(poses, reference), []
    if ape is None:
        reasons.append('no APE: the estimated or the true poses lie at one place or on one straight line, and evo '
                       'does not align such poses')
    if rpe is None:
        reasons.append(f'no RPE: no two poses are, along the true path, about {DELTA:g} m apart')
    metres, degrees = rpe or (None, None)
    return EvoMeasures(ape, metres, degrees, reasons)


def ape_rmse(poses, reference) -> float | None:
    """Return the root mean square of the absolute position error after alignment [m], as ``evo_ape --align`` does.

    The alignment is the least-squares orthogonal matrix and translation in three dimensions (Umeyama 1991), which may
    also mirror planar poses. The result is None if the poses lie on a line, which evo does not align.

    Parameters
    ----------
    poses, reference : (N, 3) float [m, m, rad]
        Poses at the same stamps, N > 1.
    """
    a, b = poses[:, :2] - poses[:, :2].mean(axis=0), reference[:, :2] - reference[:, :2].mean(axis=0)
    u, spread, vt = np.linalg.svd(b.T @ a / len(a))
    if spread[1] <= np.finfo(float).eps:
        return None
    return float(np.sqrt(((a @ (u @ vt).T - b) ** 2).sum(axis=1).mean()))


def rpe_rmse(poses, reference):
    """Return the RMS of the relative pose errors over `DELTA` of the reference path: translation [m], rotation [deg].

    The command is ``evo_rpe --delta 1 --delta_unit m --all_pairs --pairs_from_reference``, with ``--pose_relation
    trans_part`` and ``angle_deg``. The result is None if there is no pair of poses.
    """
    first, second = all_pairs(reference)
    if not len(first):
        return None
    found = errors(relative(poses[first], poses[second]), relative(reference[first], reference[second]))
    return tuple(float(np.sqrt((values ** 2).mean())) for values in found)


def all_pairs(reference):
    """Return for each pose the index of the pose whose path length from it in the reference is closest to `DELTA`."""
    steps = np.diff(reference[:, :2], axis=0)
    path = np.concatenate(([0.0], np.cumsum(np.linalg.norm(steps, axis=1))))
    begin = np.maximum(np.searchsorted(path, path + 0.5 * DELTA), np.arange(1, len(path) + 1))
    end = np.searchsorted(path, path + 1.5 * DELTA)
    pairs = []
    for i, (start, stop) in enumerate(zip(begin, end, strict=True)):
        if start < stop:
            off = np.abs(path[start:stop] - path[i] - DELTA)
            j = int(np.argmin(off))
            if off[j] <= TOLERANCE * DELTA:
                pairs.append((i, start + j))
    first, second = np.array(pairs, dtype=int).reshape(-1, 2).T
    return first, second
