# SPDX-License-Identifier: Apache-2.0
"""Free-space profile of a scan: how far it saw in each direction."""
import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ..geometry.se2 import as_complex


@dataclass(frozen=True, eq=False)
class FreeSpaceProfile:
    """How far a scan saw in every direction.

    Attributes
    ----------
    near, far : (B,) float [m]
        Least and greatest range of the beams that touch each bin of the full circle; 0 where the scan does not know.
    """

    near: np.ndarray
    far: np.ndarray

    @cached_property
    def nearby(self):
        """`near`, the least of each bin and the two on either side of it, for bearings that are not known to a bin."""
        near = np.concatenate((self.near[-2:], self.near, self.near[:2]))
        return np.lib.stride_tricks.sliding_window_view(near, 5).min(axis=1)

    def bins(self, places):
        """Bin of each of the `places` (complex, [m]) as seen from the sensor."""
        return bins(places, len(self.near))

    def violation(self, places, tolerance):
        """1 for a place well in front of what the scan saw there, fading to 0 within the `tolerance` [m]."""
        return in_front(np.abs(places), self.near.take(self.bins(places)), tolerance)


def bins(places, size):
    """Of so many bins of the full circle, that of each of the `places` (complex, [m])."""
    # Of numbers that lie side by side an angle takes a third of the time.
    bearing = np.arctan2(places.imag.copy(), places.real.copy())
    bearing += math.pi
    bearing *= size / (2.0 * math.pi)
    return np.minimum(bearing.astype(np.intp), size - 1)


def in_front(radius, near, tolerance):
    """1 where a `radius` is well below `near`, fading to 0 within the `tolerance` [m]."""
    front = near - radius
    front -= tolerance
    front *= 1.0 / tolerance
    np.maximum(front, 0.0, out=front)
    return np.minimum(front, 1.0, out=front)


@lru_cache(maxsize=4)
def _edges(size):
    """Bearings [rad] between which the bins of the full circle lie, so many of them."""
    return np.arange(size + 1) * (2.0 * math.pi / size) - math.pi


def build_free_space_profile(points, increment) -> FreeSpaceProfile:
    """The `FreeSpaceProfile` of a scan from its filtered points ``(P, 2)``.

    A bin is known when beams on both of its sides have a return, no farther apart than three increments.
    """
    size = min(max(round(2.0 * math.pi / abs(increment)), 60), 2880)
    bearing, radius = np.arctan2(points[:, 1], points[:, 0]), np.abs(as_complex(points))
    order = bearing.argsort(kind='stable')
    bearing, radius = bearing[order], radius[order]
    bearing = np.concatenate((bearing[-1:] - 2.0 * math.pi, bearing, bearing[:1] + 2.0 * math.pi))
    radius = np.concatenate((radius[-1:], radius, radius[:1]))
    edges = _edges(size)
    before = bearing.searchsorted(edges, 'right') - 1
    after = before + (bearing[before] < edges)
    # A moved scan is sparse in places: what counts is that both neighbours exist, not that they are in adjacent beams.
    known = bearing[after[1:]] - bearing[before[:-1]] < 3.0 * max(abs(increment), 2.0 * math.pi / size)
    ends = radius[before[1:]], radius[after[1:]]
    near = np.minimum(np.minimum.reduceat(radius, before)[:-1], np.minimum(*ends))
    far = np.maximum(np.maximum.reduceat(radius, before)[:-1], np.maximum(*ends))
    return FreeSpaceProfile(near * known, far * known)
