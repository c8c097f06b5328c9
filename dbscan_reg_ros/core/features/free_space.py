# SPDX-License-Identifier: Apache-2.0
"""Free-space profile of a scan: the range that is known to be free in each direction."""
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..geometry.array_types import ComplexArray, FloatArray, IntArray


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


_NEARBY_BINS = 5
"""Number of bins that `FreeSpaceProfile.nearby` covers."""
