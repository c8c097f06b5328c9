# SPDX-License-Identifier: Apache-2.0
"""Evidence for and against motions."""
from ...geometry.array_types import FloatArray
from ..records import Evidence, Prior

def evidence_terms(evidence: Evidence) -> tuple[float, ...]: ...
def log_odds(evidence: Evidence, prior: Prior | None = None, candidate: FloatArray | None = None) -> float: ...
