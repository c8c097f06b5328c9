# SPDX-License-Identifier: Apache-2.0
"""Point-to-line correspondences and robust iterations (Eq. 16-18)."""
from collections.abc import Sequence

from ..geometry.array_types import FloatArray
from .residuals import Alignment

class Hypotheses:
    def __new__(cls, exempt: FloatArray, others: FloatArray = ...) -> Hypotheses: ...
    @property
    def candidates(self) -> FloatArray: ...
    @property
    def best_score(self) -> float: ...

def refine(
    candidates: FloatArray, alignment: Alignment, scales: Sequence[float]
) -> tuple[FloatArray, FloatArray]: ...
