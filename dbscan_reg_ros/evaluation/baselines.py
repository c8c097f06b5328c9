# SPDX-License-Identifier: Apache-2.0
"""Small classic registration methods for comparison (Table 1 of the paper): ICP, IDC and ICL."""
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ..core.errors import ScanError
from ..core.features.extraction import extract_features
from ..core.geometry.se2 import SE2, wrap
from ..core.registration.records import Status

TRANSLATION_CHANGE = 1e-4
ROTATION_CHANGE = 1e-4
MOST_STEPS = 50
WINDOW = math.radians(30.0)
NARROWEST = math.radians(1.0)
"""Largest difference in bearing between points paired by equal range [rad], in the first and in the last iteration."""
DECAY = 0.85
"""Factor by which the window of bearings shrinks in each iteration."""
KEPT = 0.8
"""Fraction of the pairs that are used: those with the smallest distances."""
MAX_ANGLE, MAX_DISTANCE = math.radians(30.0), 2.0
"""Largest angle [rad] and distance [m] between paired segments of ICL."""


@dataclass(frozen=True)
class Result:
    """Result with the attributes of `core.registration.records.Registration` that every method can provide."""

    transform: SE2
    """Pose of the current sensor in the reference's frame: ``p_R = transform.apply(p_O)`` (Eq. 8)."""
    status: Status
    """``OK`` if the iteration converged, else ``FAILED``."""


def iterate(step, guess) -> Result:
    """Apply ``step(transform) -> transform`` until the transform changes by less than 0.1 mm and 0.1 mrad.

    `step` returns None if it finds no correspondences; the result is then FAILED.
    """
    transform = guess
    for _ in range(MOST_STEPS):
        better = step(transform)
        if better is None:
            return Result(transform, Status.FAILED)
        change = transform.inverse() @ better
        transform = better
        if abs(change.x) + abs(change.y) < TRANSLATION_CHANGE and abs(change.theta) < ROTATION_CHANGE:
            return Result(transform, Status.OK)
    return Result(transform, Status.FAILED)


def fit(reference, current) -> SE2:
    """Return the least-squares motion from the points `current` ``(K, 2)`` [m] to `reference` ``(K, 2)`` [m]."""
    centre_r, centre_c = reference.mean(axis=0), current.mean(axis=0)
    a, b = current - centre_c, reference - centre_r
    theta = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    x, y = centre_r - SE2(0.0, 0.0, theta).apply(centre_c)
    return SE2(float(x), float(y), theta)


class Baseline(NamedTuple):
    """A method: ``prepare(scan)`` makes the data of a scan that it needs.

    ``align(reference, current, guess=SE2())`` returns a `Result` from the data of two scans.
    """

    prepare: Callable[..., Any]
    align: Callable[..., Result]


def _returns(scan):
    """Return the points ``(P, 2)`` [m] of the returns of a scan."""
    return scan.points[scan.valid]


def _segments(scan):
    """Return the `Segments` of a scan; None if it has no segments."""
    try:
        segments = extract_features(scan).segments
    except ScanError:
        return None
    return segments if len(segments) else None


def _icp(reference, current, guess=SE2()) -> Result:
    """Pair each point with the nearest point of the reference, estimate the motion by least squares, and repeat."""
    tree = cKDTree(reference)

    def step(transform):
        _, nearest = tree.query(transform.apply(current))
        return fit(reference[nearest], current)

    return iterate(step, guess)


def _idc(reference, current, guess=SE2()) -> Result:
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


def _icl(reference, current, guess=SE2()) -> Result:
    """Pair each segment with the nearest line of similar direction, estimate rotation and translation, and repeat."""
    def step(transform):
        if reference is None or current is None:
            return None
        return _closer(reference, current, transform)

    return iterate(step, guess)


def _closer(reference, current, transform):
    middle = transform.apply(current.midpoint)
    turn = wrap(reference.direction[:, None] - current.direction - transform.theta)
    normal = np.stack((-np.sin(reference.direction), np.cos(reference.direction)), axis=1)
    offset = reference.midpoint[:, None] - middle
    aside = (offset * normal[:, None]).sum(axis=-1)
    beyond = np.maximum(np.linalg.norm(offset, axis=-1) - 0.5 * (reference.length[:, None] + current.length), 0.0)
    distance = np.where(np.abs(turn) < MAX_ANGLE, np.hypot(aside, beyond), np.inf)
    pairs = distance.argmin(axis=0), np.arange(len(current))
    near = distance[pairs] < MAX_DISTANCE
    if not near.any():
        return None
    pairs = pairs[0][near], pairs[1][near]
    weight = np.minimum(reference.length[pairs[0]], current.length[pairs[1]])
    rotation = SE2(0.0, 0.0, float(np.average(turn[pairs], weights=weight)))
    turned = rotation @ transform
    n = normal[pairs[0]]
    aside = ((reference.midpoint[pairs[0]] - turned.apply(current.midpoint[pairs[1]])) * n).sum(axis=1)
    root = np.sqrt(weight)
    x, y = np.linalg.lstsq(root[:, None] * n, root * aside, rcond=1e-3)[0]
    return SE2(float(x), float(y), 0.0) @ turned


icp = Baseline(_returns, _icp)
"""Iterative closest point, point to point (Besl and McKay, 1992)."""
idc = Baseline(_returns, _idc)
"""Iterative dual correspondence (Lu and Milios, 1994): one pairing for the translation, another for the rotation."""
icl = Baseline(_segments, _icl)
"""Iterative closest line (Alshawa, 2007): pairs of line segments instead of pairs of points."""
