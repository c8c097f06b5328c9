# SPDX-License-Identifier: Apache-2.0
"""Hint for a trajectory whose poses seem to be those of the base instead of the sensor."""
import math

import numpy as np

from ..core.geometry.rounding import fixed
from ..recordings.poses import compose, relative
from .metrics import errors

SMALLEST_ERROR = 0.01
"""Root mean square error of the translation [m] below which there is no hint."""
MOST_LEFT = 0.25
"""Largest fraction of this error that may remain with the offset."""
LEAST_SINGULAR = 1e-2
"""Smaller singular values, relative to the largest, are zero: without rotations the position has no effect."""


def hint(motions, true_motions) -> str:
    """Return a hint if a constant pose of the sensor explains most of the translation error; else an empty string.

    The motions ``(K, 3)`` [m, m, rad] are those of a trajectory and of the sensor between the same pairs of scans.
    """
    offset = sensor_offset(motions, true_motions)
    placed = np.broadcast_to(offset, motions.shape)
    before, after = (_rms(found, true_motions) for found in (
        motions, compose(relative(placed, motions), placed)))
    if before < SMALLEST_ERROR or after > MOST_LEFT * before:
        return ''
    place = ','.join((fixed(offset[0], 2), fixed(offset[1], 2), fixed(math.degrees(offset[2]), 0)))
    return (f'with the sensor at about {place} on these poses the root mean square '
            f'error of the translation over 1 m is {after:.4f} m instead of {before:.4f} m: if they are the poses of '
            'the base, name the pose of the sensor on it, NAME=FILE@X,Y,DEG; '
            'with a pose that was named already, compose both')


def sensor_offset(motions, true_motions):
    """Return the pose ``(3,)`` of the sensor on the moving frame of `motions` that explains the `true_motions` best.

    A frame with the motion (R, b) has a sensor with the pose (A, t). Its motion has the translation ``A^T b + (R - I)
    A^T t``, which is linear in ``A^T`` and ``A^T t``.
    """
    c, s = np.cos(motions[:, 2]) - 1.0, np.sin(motions[:, 2])
    bx, by = motions[:, 0], motions[:, 1]
    rows = np.concatenate((np.stack((bx, by, c, -s), axis=1), np.stack((by, -bx, s, c), axis=1)))
    cosine, sine, u, v = np.linalg.lstsq(rows, true_motions[:, :2].T.ravel(), rcond=LEAST_SINGULAR)[0]
    theta = math.atan2(sine, cosine)
    return np.array((math.cos(theta) * u - math.sin(theta) * v, math.sin(theta) * u + math.cos(theta) * v, theta))


def _rms(motions, true_motions) -> float:
    return float(np.sqrt((errors(motions, true_motions)[0] ** 2).mean()))
