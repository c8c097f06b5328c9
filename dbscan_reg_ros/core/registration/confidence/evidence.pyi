# SPDX-License-Identifier: Apache-2.0
"""Evidence for and against motions."""
from collections.abc import Sequence

from ...features.records import Features
from ...geometry.array_types import FloatArray
from ...parameters.tree import Parameters
from ..hypotheses import Assessment, Ranking
from ..records import Evidence, Prior
from ..residuals import Fit
from ..search import Problem

def collect_evidence(
    candidates: FloatArray,
    fits: Fit,
    weak: Sequence[float],
    reference: Features,
    current: Features,
    parameters: Parameters,
) -> list[Evidence]: ...
def evidence_terms(evidence: Evidence) -> tuple[float, ...]: ...
def log_odds(evidence: Evidence, prior: Prior | None = None, candidate: FloatArray | None = None) -> float: ...
def assess(problem: Problem, fine: Ranking) -> Assessment: ...
