# SPDX-License-Identifier: Apache-2.0
"""Repeated ranges of a scan."""
import numpy as np
from numpy.typing import NDArray

from .geometry.array_types import FloatArray

def with_repeated_end(
    ranges: NDArray[np.float32], range_max: float, fewest: int, stray: float
) -> FloatArray | None: ...
