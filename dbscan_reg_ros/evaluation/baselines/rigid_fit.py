# SPDX-License-Identifier: Apache-2.0
"""Least-squares rigid motion between paired points."""
import math

from ...core.geometry.se2 import SE2


def fit(reference, current) -> SE2:
    """Return the least-squares motion from the points `current` ``(K, 2)`` [m] to `reference` ``(K, 2)`` [m]."""
    centre_r, centre_c = reference.mean(axis=0), current.mean(axis=0)
    a, b = current - centre_c, reference - centre_r
    theta = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    x, y = centre_r - SE2(0.0, 0.0, theta).apply(centre_c)
    return SE2(float(x), float(y), theta)
