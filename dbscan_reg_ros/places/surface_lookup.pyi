# SPDX-License-Identifier: Apache-2.0
"""Points of a drive looked up in a grid: aligned with its surfaces, and counted by what the map has there."""
from typing import final

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.array_types import FloatArray

@final
class SurfaceLookup:
    def __init__(self, values: NDArray[np.int8], distance: NDArray[np.float32], resolution: float) -> None: ...
    def align(
        self, poses: FloatArray, points: FloatArray, scales: FloatArray
    ) -> tuple[FloatArray, FloatArray]: ...
    def count(
        self, poses: FloatArray, hits: FloatArray, fronts: FloatArray, squares: FloatArray, reach: float
    ) -> FloatArray: ...
