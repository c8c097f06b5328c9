# SPDX-License-Identifier: Apache-2.0
"""Iterative dual correspondence (Lu and Milios, 1994): one pairing for the translation, another for the rotation."""
import math

import numpy as np
from scipy.spatial import cKDTree

from ...core.geometry.se2 import SE2, wrap
from .result import Result, fit, iterate

WINDOW = math.radians(30.0)
NARROWEST = math.radians(1.0)
"""Largest difference in bearing between points paired by equal range [rad], in the first and in the last iteration."""
DECAY = 0.85
"""Factor by which the window of bearings shrinks in each iteration."""
KEPT = 0.8
"""Fraction of the pairs that are used: those with the smallest distances."""


def prepare(scan):
    """Return the points ``(P, 2)`` [m] of the returns of a scan."""
    return scan.points[scan.valid]


def align(reference, current, guess=SE2()) -> Result:
    """Estimate the rotation from points of equal range and similar bearing, the translation from closest points."""
    tree = cKDTree(reference)
    ranges, bearings = _polar(reference)
    window = WINDOW

    def step(transform):
        nonlocal window
        moved = transform.apply(current)
        alike, found = _same_range(ranges, bearings, moved, window)
        window = max(DECAY * window, NARROWEST)
        if not found.any():
            return None
        turn = SE2(0.0, 0.0, _trimmed_fit(reference[alike[found]], moved[found]).theta)
        turned = turn.apply(moved)
        closest = reference[tree.query(turned)[1]]
        shift = (closest - turned)[_nearest(closest, turned)].mean(axis=0)
        return SE2(*shift.tolist(), turn.theta) @ transform

    return iterate(step, guess)


def _same_range(ranges, bearings, points, window):
    """Return the index of the reference point of most similar range in each point's window, and whether it exists."""
    point_ranges, point_bearings = _polar(points)
    difference = np.abs(ranges - point_ranges[:, None])
    difference[np.abs(wrap(bearings - point_bearings[:, None])) > window] = np.inf
    index = difference.argmin(axis=1)
    return index, np.isfinite(difference[np.arange(len(points)), index])


def _trimmed_fit(reference, current):
    kept = _nearest(reference, current)
    return fit(reference[kept], current[kept])


def _nearest(reference, current):
    distance = np.linalg.norm(reference - current, axis=1)
    return distance <= np.quantile(distance, KEPT)


def _polar(points):
    return np.hypot(points[:, 0], points[:, 1]), np.arctan2(points[:, 1], points[:, 0])
