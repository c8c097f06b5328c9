# SPDX-License-Identifier: Apache-2.0
"""Measures of trajectories as the commands of evo compute and name them (``evo_ape``, ``evo_rpe``).

evo is free under the GPL: nothing of it is imported or copied. A test runs its commands on the same files and compares.
"""
import numpy as np

from ..recordings.poses import relative
from .metrics import errors

DELTA = 1.0
"""Length of the path between the poses of a pair [m], ``--delta 1 --delta_unit m``."""
TOLERANCE = 0.1
"""Pairs whose path differs from `DELTA` by more than this fraction are left out."""


def ape_rmse(poses, reference) -> float:
    """Root mean square of the absolute position error after alignment [m]: ``evo_ape --align``.

    The alignment is the orthogonal matrix and translation with the least squares (Umeyama 1991) in three dimensions, in
    which planar poses may be mirrored as well. Not a number where the poses lie on a line, which evo does not align.

    Parameters
    ----------
    poses, reference : (N, 3) float [m, m, rad]
        Poses at the same stamps, N > 1.
    """
    a, b = poses[:, :2] - poses[:, :2].mean(axis=0), reference[:, :2] - reference[:, :2].mean(axis=0)
    u, spread, vt = np.linalg.svd(b.T @ a / len(a))
    if spread[1] <= np.finfo(float).eps:
        return np.nan
    return float(np.sqrt(((a @ (u @ vt).T - b) ** 2).sum(axis=1).mean()))


def rpe_rmse(poses, reference):
    """Root mean squares of the relative pose errors over `DELTA` of the reference, translation [m] and rotation [deg].

    ``evo_rpe --delta 1 --delta_unit m --all_pairs --pairs_from_reference``, with ``--pose_relation trans_part`` and
    ``angle_deg``; not a number without a pair.
    """
    first, second = all_pairs(reference)
    if not len(first):
        return np.nan, np.nan
    found = errors(relative(poses[first], poses[second]), relative(reference[first], reference[second]))
    return tuple(float(np.sqrt((values ** 2).mean())) for values in found)


def all_pairs(reference):
    """Return indices of the pairs of poses whose path in the reference is closest to `DELTA`, for each first pose."""
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
