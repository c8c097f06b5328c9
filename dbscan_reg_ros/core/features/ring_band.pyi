# SPDX-License-Identifier: Apache-2.0
"""Ring band filter: tests each beam against the ring of beams around it (section 2.1, Eq. 3-4)."""
from enum import IntEnum

from ..geometry.array_types import FloatArray, IntArray
from ..parameters.features import RingBandParameters

class Outcome(IntEnum):
    KEPT = 0
    SMOOTHED = 1
    CORNER = 2
    REMOVED = 3

def ring_band_filter(
    points: FloatArray, noise: float, parameters: RingBandParameters
) -> tuple[FloatArray, IntArray]: ...
