# SPDX-License-Identifier: Apache-2.0
"""Refinement and ranking of hypotheses by the density of the reference (section 2.3)."""
from .hypotheses import Candidates
from .point_to_line import Hypotheses
from .problem import Problem

def rank_by_density(problem: Problem, candidates: Candidates, min_score: float) -> Hypotheses: ...
