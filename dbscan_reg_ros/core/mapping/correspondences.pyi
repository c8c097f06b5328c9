# SPDX-License-Identifier: Apache-2.0
"""Point-to-line correspondences of a scan with all key frames, and robust alignment by them."""
from collections.abc import Sequence
from typing import final

from ..geometry.array_types import BoolArray, FloatArray, IntArray
from ..geometry.se2 import SE2
from .records import PosePrior

@final
class Correspondences:
    pose: SE2
    size: int
    def __new__(cls, size: int, most: int) -> Correspondences: ...
    def __len__(self) -> int: ...
    @property
    def frame(self) -> IntArray: ...
    @property
    def index(self) -> IntArray: ...
    @property
    def rows(self) -> FloatArray: ...
    @property
    def weights(self) -> FloatArray: ...
    def match(self, other: SE2, scale: float) -> tuple[FloatArray, FloatArray]: ...

def weighted_by_agreement(
    found: Correspondences, own: Correspondences, is_own: BoolArray, scale: float, noise: float
) -> None: ...
def align(
    found: Correspondences, start: SE2, prior: PosePrior, scales: Sequence[float], damping: float
) -> SE2: ...
