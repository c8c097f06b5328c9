# SPDX-License-Identifier: Apache-2.0
"""Free-space profile of a scan: the range that is known to be free in each direction."""
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ..geometry.array_types import ComplexArray, FloatArray, IntArray
from ..geometry.se2 import as_complex


@dataclass(frozen=True, eq=False)
class FreeSpaceProfile:
    """Least and greatest range of a scan in each bearing bin of the full circle.

    Attributes
    ----------
    near, far : (B,) float [m]
        Least and greatest range of the beams that touch each bin; 0 for bins without information.
    """

    near: FloatArray
    far: FloatArray

    @cached_property
    def nearby(self) -> FloatArray:
        """``(B,)`` smallest `near` [m] among each bin and the neighbouring bins, to allow for bearing errors."""
        near = np.concatenate((self.near[-2:], self.near, self.near[:2]))
        nearby: FloatArray = np.lib.stride_tricks.sliding_window_view(near, _NEARBY_BINS).min(axis=1)
        return nearby

    def bins(self, points: ComplexArray) -> IntArray:
        """Return the bin of each of the `points` (complex, any shape, [m]) in the frame of the scan."""
        return bins(points, len(self.near))

    def violation(self, points: ComplexArray, tolerance: float | FloatArray) -> FloatArray:
        """Return how far points lie in front of the measured ranges: 0 up to the `tolerance` [m], 1 from twice that."""
        return in_front(np.abs(points), self.near.take(self.bins(points)), tolerance)


def bins(points: ComplexArray, size: int | IntArray) -> IntArray:
    """Return the bin of each of the `points` (complex, [m]), with `size` bins in the full circle."""
    # Contiguous copies: arctan2 takes a third of the time.
    bearing = np.arctan2(points.imag.copy(), points.real.copy())
    bearing += math.pi
    bearing *= size / (2.0 * math.pi)
    numbers: IntArray = np.minimum(bearing.astype(np.intp), size - 1)
    return numbers


def in_front(radius: FloatArray, near: FloatArray, tolerance: float | FloatArray) -> FloatArray:
    """Return how far a `radius` [m] is below `near` [m]: 0 up to the `tolerance` [m], rising to 1 at twice that."""
    front: FloatArray = near - radius
    front -= tolerance
    front *= 1.0 / tolerance
    np.maximum(front, 0.0, out=front)
    return np.minimum(front, 1.0, out=front)


@lru_cache(maxsize=2)
def _edges(size: int) -> FloatArray:
    """Return the bearings [rad] of the edges of `size` bins of the full circle."""
    edges: FloatArray = np.arange(size + 1, dtype=float) * (2.0 * math.pi / size) - math.pi
    return edges


def build_free_space_profile(points: FloatArray, increment: float) -> FreeSpaceProfile:
    """Build the `FreeSpaceProfile` of a scan.

    A bin has information when returns next to both of its edges are less than three increments apart.

    Parameters
    ----------
    points : (P, 2) float
        Filtered points in the frame of the sensor [m].
    increment : float
        Step from one beam to the next [rad].
    """
    size = min(max(round(2.0 * math.pi / abs(increment)), _MIN_BINS), _MAX_BINS)
    bearing, radius = np.arctan2(points[:, 1], points[:, 0]), np.abs(as_complex(points))
    order = bearing.argsort(kind='stable')
    bearing, radius = bearing[order], radius[order]
    bearing = np.concatenate((bearing[-1:] - 2.0 * math.pi, bearing, bearing[:1] + 2.0 * math.pi))
    radius = np.concatenate((radius[-1:], radius, radius[:1]))
    edges = _edges(size)
    before = bearing.searchsorted(edges, 'right') - 1
    after = before + (bearing[before] < edges)
    # Deskewed scans are sparse in places: the neighbours need not be of adjacent beams.
    known = bearing[after[1:]] - bearing[before[:-1]] < 3.0 * max(abs(increment), 2.0 * math.pi / size)
    ends = radius[before[1:]], radius[after[1:]]
    near = np.minimum(np.minimum.reduceat(radius, before)[:-1], np.minimum(*ends))
    far = np.maximum(np.maximum.reduceat(radius, before)[:-1], np.maximum(*ends))
    return FreeSpaceProfile(near * known, far * known)


_NEARBY_BINS = 5
"""Number of bins that `FreeSpaceProfile.nearby` covers."""
_MIN_BINS, _MAX_BINS = 60, 2880
"""Least and greatest number of bins of a free-space profile."""
