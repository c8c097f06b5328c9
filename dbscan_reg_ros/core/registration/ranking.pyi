# SPDX-License-Identifier: Apache-2.0
"""Refinement and ranking of hypotheses by the density of the reference (section 2.3)."""
from ..features.free_space import FreeSpaceProfile
from ..features.oriented_points import OrientedPoints
from ..geometry.array_types import FloatArray
from ..parameters.registration import DensityParameters, SelectionParameters
from .hypotheses import Candidates, Ranking
from .search import Problem

def rank_by_density(problem: Problem, candidates: Candidates, min_score: float) -> Ranking: ...
def preselect(
    candidates: FloatArray,
    points: OrientedPoints,
    profile: FreeSpaceProfile,
    parameters: SelectionParameters,
    density: DensityParameters,
) -> FloatArray: ...
