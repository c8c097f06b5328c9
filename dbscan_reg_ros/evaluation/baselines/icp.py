# SPDX-License-Identifier: Apache-2.0
"""Iterative closest point, point to point (Besl and McKay, 1992)."""
from scipy.spatial import cKDTree

from ...core.geometry.se2 import SE2
from .result import Result, fit, iterate


def prepare(scan):
    """Return the points ``(P, 2)`` [m] of the returns of a scan."""
    return scan.points[scan.valid]


def align(reference, current, guess=SE2()) -> Result:
    """Pair each point with the nearest point of the reference, estimate the motion by least squares, and repeat."""
    tree = cKDTree(reference)

    def step(transform):
        _, nearest = tree.query(transform.apply(current))
        return fit(reference[nearest], current)

    return iterate(step, guess)
