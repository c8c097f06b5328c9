# SPDX-License-Identifier: Apache-2.0
"""Ranking of refined hypotheses by the evidence for each."""
import numpy as np

from ...geometry.array_types import FloatArray
from ...geometry.ties import order_up_to_rounding
from ..hypotheses import Ranking
from ..records import Evidence
from ..residuals import Fit
from ..scoring import distinct
from ..search import Problem
from ..uncertainty import uncertainty
from .evidence import collect_evidence, log_odds


def rank_by_evidence(problem: Problem, fine: Ranking) -> Ranking:
    """Return the hypotheses that are different motions, those with the largest log-odds first.

    With a prior those with the largest score are first, as it contains the distance from the prior. A single hypothesis
    is not compared; its evidence is collected when it has been polished.
    """
    d = problem.parameters.decision
    if len(fine.candidates) == 1:
        return fine
    kept = fine.select(distinct(fine.candidates, len(fine.candidates), d.rival_distance, d.rival_angle))
    if len(kept.candidates) == 1:
        return kept
    evidence, fits = evidence_of(problem, kept.candidates)
    odds = np.array([log_odds(each, problem.prior, candidate)
                     for each, candidate in zip(evidence, kept.candidates, strict=True)])
    order = order_up_to_rounding(-odds if problem.prior is None else -kept.score)
    return kept._replace(odds=odds).select(order)._replace(best=fits[order[0]])


def evidence_of(problem: Problem, candidates: FloatArray) -> tuple[list[Evidence], list[Fit]]:
    """Return the evidence for each of the hypotheses ``(H, 3)``, and the `Fit` of each."""
    reference, current, p = problem.reference, problem.current, problem.parameters
    points, noise = current.sampled_points, max(reference.noise, current.noise)
    fits = problem.fit(candidates, points)
    each = [fits.select(slice(k, k + 1)) for k in range(len(candidates))]
    weak = [uncertainty(candidate, found, points, noise, p)[1].weak
            for candidate, found in zip(candidates, each, strict=True)]
    return collect_evidence(candidates, fits, weak, reference, current, p), each
