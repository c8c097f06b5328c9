# SPDX-License-Identifier: Apache-2.0
"""Assessment of refined hypotheses: which is the best, the evidence for it, its uncertainty, and its rivals."""
from ...geometry.array_types import FloatArray
from ..hypotheses import Assessment
from ..point_to_line import Hypotheses
from ..problem import Problem
from ..records import Evidence

def assess(problem: Problem, found: Hypotheses) -> Assessment: ...
def evidence_of(problem: Problem, candidates: FloatArray) -> list[Evidence]: ...
