# SPDX-License-Identifier: Apache-2.0
"""Free-space profile of a scan: the range that is known to be free in each direction."""
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..geometry.array_types import FloatArray


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


_NEARBY_BINS = 5
"""Number of bins that `FreeSpaceProfile.nearby` covers."""
