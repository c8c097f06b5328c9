# SPDX-License-Identifier: Apache-2.0
"""Point-to-line correspondences and robust iterations (Eq. 16-18)."""
from collections.abc import Sequence

from ..features.likelihood_field import LikelihoodField
from ..features.oriented_points import OrientedPoints
from ..geometry.array_types import FloatArray
from ..parameters.registration import RefinementParameters
from .hypotheses import Ranking
from .residuals import Alignment, Fit
from .search import Problem

def fit(
    candidates: FloatArray, points: OrientedPoints, field: LikelihoodField, min_normal_cosine: float
) -> Fit: ...
def refine(
    candidates: FloatArray, alignment: Alignment, scales: Sequence[float]
) -> tuple[FloatArray, FloatArray]: ...
def polish(
    candidate: FloatArray, found: Fit, points: OrientedPoints, refinement: RefinementParameters
) -> tuple[FloatArray, Fit]: ...
def polish_best(problem: Problem, fine: Ranking) -> Ranking: ...
