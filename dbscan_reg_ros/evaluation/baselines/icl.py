# SPDX-License-Identifier: Apache-2.0
"""Iterative closest line (Alshawa, 2007): pairs of line segments instead of pairs of points."""
import math

import numpy as np

from ...core.errors import ScanError
from ...core.features.extraction import extract_features
from ...core.geometry.se2 import SE2, wrap
from .result import Result, iterate

MAX_ANGLE = math.radians(30.0)
MAX_DISTANCE = 2.0


def prepare(scan):
    """Return the `Segments` of a scan; None if it has no segments."""
    try:
        segments = extract_features(scan).segments
    except ScanError:
        return None
    return segments if len(segments) else None


def align(reference, current, guess=SE2()) -> Result:
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
