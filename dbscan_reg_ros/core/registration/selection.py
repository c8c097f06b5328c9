# SPDX-License-Identifier: Apache-2.0
"""Selection of one hypothesis by the density of the reference: refine, score, rank (section 2.3)."""
import dataclasses

import numpy as np

from .confidence.ranking import rank_by_evidence
from .hypotheses import Candidates, Ranking
from .point_to_line import polish_best
from .ranking import rank_by_density
from .records import Registration
from .search import Problem
from .status import decide, failed


def select_by_density(problem: Problem, candidates: Candidates, min_score: float = -np.inf) -> Registration:
    """Refine the hypotheses and return the best of them.

    Parameters
    ----------
    problem : Problem
    candidates : Candidates
    min_score : float
        If the best score cannot exceed this, the search ends early and returns ``FAILED`` with that score.
    """
    if not candidates.size:
        return failed('no segments of the two scans match')
    if not len(problem.current.sampled_points):
        return failed('no returns of the current scan have a normal')
    ranking = rank_by_density(problem, candidates, min_score)
    if ranking.score[0] <= min_score:
        return failed_below(min_score, ranking)
    return decide(problem, polish_best(problem, rank_by_evidence(problem, ranking)))


def failed_below(min_score: float, ranking: Ranking) -> Registration:
    """Return a registration that failed because its best score is not above the `min_score`."""
    value = float(ranking.score[0])
    return dataclasses.replace(failed(f'score {value:.2f}; expected more than {min_score:.2f}'), score=value)
