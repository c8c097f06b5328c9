# SPDX-License-Identifier: Apache-2.0
"""Selection of one hypothesis by the density of the reference: refine, score, rank (section 2.3)."""
import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from ..features.oriented_points import OrientedPoints
from ..features.points import sample
from ..geometry.array_types import FloatArray
from ..geometry.se2 import DOF
from ..geometry.ties import order_up_to_rounding
from ..geometry.tolerance import TINY
from .confidence.ranking import rank_by_evidence
from .degeneracy import search_degenerate_direction, weakest_direction
from .point_to_line import Fit, next_step, polish
from .records import Registration
from .scoring import distinct, preselect, promising, reverse_violation, score, squared_mahalanobis
from .search import Candidates, Problem, Ranking
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
    step = problem.current.backend.step
    ranking = step(rank_by_density)(problem, candidates, min_score)
    if ranking.score[0] <= min_score:
        return failed_below(min_score, ranking)
    return decide(problem, step(polish_best)(problem, rank_by_evidence(problem, ranking)))


def rank_by_density(problem: Problem, candidates: Candidates, min_score: float) -> Ranking:
    """Refine the hypotheses and rank them by their scores, first coarsely, then finely.

    Parameters
    ----------
    problem : Problem
    candidates : Candidates
        At least one.
    min_score : float
        Refinement ends as soon as the best score is known to be at most this.
    """
    ranking = refine_coarsely(problem, candidates)
    return ranking if ranking.score[0] <= min_score else refine_finely(problem, ranking)


def failed_below(min_score: float, ranking: Ranking) -> Registration:
    """Return a registration that failed because its best score is not above the `min_score`."""
    value = float(ranking.score[0])
    return dataclasses.replace(failed(f'score {value:.2f}; expected more than {min_score:.2f}'), score=value)


def refine_coarsely(problem: Problem, candidates: Candidates) -> Ranking:
    """Pre-select and refine the hypotheses with a kernel that narrows from `refinement.coarse_scale`.

    Without a prior, most hypotheses are far off: a subset of the points is enough to find the promising ones. If the
    best hypothesis has not converged, the promising ones are refined once more with all points; the results before that
    stay among the hypotheses, because the second refinement may overshoot.
    """
    p, points = problem.parameters, problem.current.sampled_points
    scales = p.refinement.coarse_scales()
    if problem.prior is not None:
        chosen = preselect(candidates.others, points, problem.reference.free_space, p.selection, p.density)
        return improve(problem, np.concatenate((candidates.exempt, chosen)), points, scales)
    some = sample(points, p.selection.preselection_points)
    start = candidates.joined()
    start, fits = promising(start, problem.fit(start, some), p.refinement.coarse_scale, p.selection.min_support_ratio)
    coarse = improve(problem, start, some, scales, fits)
    step = next_step(coarse.best, points, p.refinement.fine_scale, p.refinement.damping)
    if math.hypot(step[0], step[1]) < p.refinement.final_scale:
        return coarse
    return coarse.joined(improve(problem, coarse.candidates, points, scales))


def refine_finely(problem: Problem, coarse: Ranking) -> Ranking:
    """Refine the top candidates with a kernel that narrows to `refinement.final_scale`, and compare their scores.

    The scores account for points of either scan in free space of the other. A single top candidate is not compared;
    `polish_best` runs its last iterations.
    """
    p = problem.parameters
    top = select_top_candidates(problem, coarse)
    compared = with_shifted_along_degenerate(problem, top)
    points, scales = problem.current.sampled_points, p.refinement.fine_scales()
    if len(compared) > 1:
        return improve(problem, compared, points, scales, both_ways=True)
    if p.refinement.polish_iterations:
        return top
    refined, _ = problem.refine(compared, points, scales, top.best)
    return top.with_best(refined[0], problem.fit(refined, points))


def select_top_candidates(problem: Problem, coarse: Ranking) -> Ranking:
    """Return the hypotheses for the fine comparison, most plausible first: the best hypothesis and its rivals."""
    s, d = problem.parameters.selection, problem.parameters.decision
    if len(distinct(coarse.candidates, 2, s.same_distance, s.same_angle)) == 1:
        return coarse.select([0])
    value = plausibility(problem, coarse)
    order = order_up_to_rounding(-value)
    order = order[value[order] >= value[order[0]] - s.max_score_gap]
    ranked = coarse.select(order)
    top = distinct(ranked.candidates, s.top_candidates, s.same_distance, s.same_angle)
    chosen = ranked.select(sorted({*top, *distinct(ranked.candidates, 1 + _RIVALS, d.rival_distance, d.rival_angle)}))
    return chosen if order[0] == 0 else chosen._replace(best=problem.fit(chosen.candidates[:1],
                                                                         problem.current.sampled_points))


def plausibility(problem: Problem, ranking: Ranking) -> FloatArray:
    """Return the score of each hypothesis minus the square roots of the fractions of each scan's points in free space.

    A few points that contradict a hypothesis are stronger evidence than many points that agree. Without the square
    roots, wrong motions with a large overlap outrank the right motion with a small overlap.
    """
    back = reverse_violation(ranking.candidates, problem.reference, problem.current, problem.parameters.density)
    value: FloatArray = ranking.score - np.sqrt(ranking.conflict) - np.sqrt(back)
    return value


def polish_best(problem: Problem, fine: Ranking) -> Ranking:
    """Refine the best hypothesis with all oriented points and a kernel that narrows to the spread of their errors."""
    p, points, best = problem.parameters, problem.current.sampled_points, fine.best
    if p.refinement.polish_iterations:
        points = problem.current.oriented_points
    if points is not problem.current.sampled_points:
        best = problem.fit(fine.candidates[:1], points)
    candidate, best = polish(fine.candidates[0], best, points, p.refinement)
    return fine.with_best(candidate, best.thinned(p.density.max_points))


def improve(problem: Problem, candidates: FloatArray, points: OrientedPoints, scales: Sequence[float],
            fits: Fit | None = None, *, both_ways: bool = False) -> Ranking:
    """Refine all hypotheses together with `points` of the current scan; rank them by the score of all sampled points.

    Of equal scores, as in a corridor that looks the same rotated by 180 degrees, the one nearest to the prior is first.

    Parameters
    ----------
    problem : Problem
    candidates : (H, 3) array
    points : OrientedPoints
    scales : sequence of float [m]
        Scale of the robust kernel in each iteration.
    fits : Fit, optional
        Fit of the `candidates`, if it is known.
    both_ways : bool
        Whether points of the reference in free space of the current scan lower the score as well.
    """
    p, current = problem.parameters, problem.current
    candidates, equations = problem.refine(candidates, points, scales, fits)
    found = problem.fit(candidates, current.sampled_points)
    value, overlap, conflict = score(found, problem.reference, current, p.refinement.score_scale, p.density)
    nearest = np.arange(len(value))
    if both_ways:
        reverse = reverse_violation(candidates, problem.reference, current, p.density)
        value = value - p.density.violation_weight * reverse
    if problem.prior is not None:
        distance = squared_mahalanobis(candidates, problem.prior) / p.prior.gate ** 2
        value = value - p.prior.weight * np.minimum(distance, 1.0)
        nearest = order_up_to_rounding(distance)
    order = nearest[order_up_to_rounding(-value[nearest])]
    best = found.select(slice(order[0], order[0] + 1))
    return Ranking(candidates[order], value[order], overlap[order], conflict[order], equations[order],
                   np.zeros(len(order)), best)


def with_shifted_along_degenerate(problem: Problem, ranking: Ranking) -> FloatArray:
    """Return the hypotheses, and in addition those that fit better after a shift along their degenerate direction."""
    candidates, p = ranking.candidates, problem.parameters.degeneracy
    angle, weak, strong = np.array([weakest_direction(each[:DOF, :DOF]) for each in ranking.equations]).T
    degenerate = weak < p.information_ratio * strong
    if not degenerate.any():
        return candidates
    shifted = search_degenerate_direction(candidates[degenerate], angle[degenerate], problem)
    return np.concatenate((candidates, shifted[(np.abs(shifted - candidates[degenerate]) > TINY).any(axis=1)]))


_RIVALS = 7
"""The best hypothesis is compared with at most this many rivals (hypotheses with different motions)."""
