# SPDX-License-Identifier: Apache-2.0
"""The registration of one scan onto another (Figure 13)."""
import dataclasses
import math
from typing import NamedTuple

import numpy as np

from ..features.oriented_points import sample
from ..features.records import Features
from ..parameters.tree import Parameters
from .degeneracy import search_free_direction, weakest_direction
from .landmarks import landmark_motions
from .paper.divergence import select_by_divergence
from .point_to_line import Fit, fit, next_step, polish, refine
from .records import Prior, Registration, Status
from .rotation import estimate_rotations, pair_weights
from .scoring import distinct, hopeful, not_ruled_out, reverse_violation, score, sieve, surprise
from .status import decide, failed
from .translation import estimate_translations


def register(reference: Features, current: Features, parameters: Parameters = Parameters(),
             prior: Prior | None = None, near: bool = True) -> Registration:
    """Find the motion that lays the current scan onto the reference; no initial guess is needed.

    Parameters
    ----------
    reference, current : Features
        Of the earlier and the later scan, from `extract_features`.
    parameters : Parameters
    prior : Prior, optional
        One more hypothesis, in the reference's frame.
    near : bool
        Look first at what the prior does not rule out. It costs time where the rest has to be looked at after all.

    Returns
    -------
    Registration
        ``p_R = transform.apply(p_O)`` (Eq. 8): the pose of the sensor at the current scan in the reference's frame.
    """
    p = parameters
    if current.dense_cloud.sharpness is not None and not reference.noise_share:
        # Of the same sensor: noise of far ranges that one scan alone shows is chance, or outliers.
        current = dataclasses.replace(current, noise_share=0.0)
    weights = pair_weights(reference.segments, current.segments, p.rotation)
    rotations = estimate_rotations(reference.segments, current.segments, weights, p.rotation)
    if near and prior is not None and p.selection.method == 'density':
        found = search_near(prior, reference, current, rotations, weights, p, p.prior.enough)
        if found is not None:
            return found
    translations = estimate_translations(reference.segments, current.segments, rotations, weights, p.translation)
    if p.selection.method == 'divergence':
        return select_by_divergence(reference, current, rotations, translations, p)
    sure, most = translations.shortest, p.selection.heaviest
    if prior is not None:
        sure, most = np.concatenate((prior.transform.as_array()[None], sure)), p.selection.candidates
    candidates = translations.transform[:most]
    if p.selection.landmarks and p.selection.widen == 1:
        candidates = np.concatenate((landmark_motions(reference, current, p, prior), candidates))
    found = select(sure, candidates, reference, current, p, prior)
    doubtful = found.score < p.selection.doubt or prior is None and found.status is not Status.OK
    if doubtful and p.selection.widen > 1:
        wide = register(reference, current, p.widened, prior, near=False)
        if wide.score > found.score + p.selection.better:
            return wide
    return found


def register_near(reference: Features, current: Features, parameters: Parameters, prior: Prior) -> Registration:
    """The best of what the prior does not rule out, however well others may fit: as `register`."""
    weights = pair_weights(reference.segments, current.segments, parameters.rotation)
    rotations = estimate_rotations(reference.segments, current.segments, weights, parameters.rotation)
    return search_near(prior, reference, current, rotations, weights, parameters, -np.inf)


def search_near(prior, reference, current, rotations, weights, p, least):
    """The best of what the prior does not rule out; None where it scores no more than `least`."""
    expected = prior.transform.as_array()
    near = rotations.near(expected[2], p.prior.limit * prior.angular_spread)
    translations = estimate_translations(reference.segments, current.segments, near, weights, p.translation)
    candidates = translations.transform
    candidates = candidates[not_ruled_out(candidates, prior, p.prior)]
    return select(expected[None], candidates[:p.selection.candidates], reference, current, p, prior, least)


def select(sure, candidates, reference, current, p, prior, least=-np.inf):
    """The best of all hypotheses, as a `Registration`.

    Parameters
    ----------
    sure, candidates : (S, 3), (C, 3) arrays
        Hypotheses that pass the sieve in any case, and those that have to, where there is a prior.
    least : float
        Nothing that scores no more than this is of any use: None, then.
    """
    if not len(sure) + len(candidates):
        return failed('no line of one scan has a partner in the other')
    if not len(current.cloud):
        return failed('no returns of the scan lie on a surface')
    if prior is None:
        # Most hypotheses are far off: a part of the points tells which, and leads the others close enough.
        cloud, candidates = sample(current.cloud, p.selection.sieve_points), np.concatenate((sure, candidates))
        candidates, found = hopeful(candidates, fit(candidates, cloud, reference.surface, p.density.facing),
                                    p.refinement.coarse_scale, p.selection.hopeful)
    else:
        cloud, found = current.cloud, None
        candidates = np.concatenate((sure, sieve(candidates, cloud, reference.view, p.selection, p.density)))
    coarse = approach(candidates, found, cloud, reference, current, p, prior)
    if coarse.score[0] <= least:
        return None
    chosen = distinct(coarse.candidates, p.selection.finalists, p.selection.same_distance, p.selection.same_angle)
    close = [each for each in chosen if coarse.score[each] >= coarse.score[0] - p.selection.clear]
    finalists = follow_free_direction(coarse.candidates[close], coarse.equations[close], reference, current, p)
    if len(finalists) > 1:
        fine, fine_score, overlap, _, found = improve(
            finalists, None, current.cloud, p.refinement.fine_scales(), reference, current, p, prior, both_ways=True)
        if fine_score[0] <= least:
            return None
    else:
        fine, fine_score, overlap, found = coarse.candidates[chosen], coarse.score[chosen], coarse.overlap[chosen], coarse.best
        if not p.refinement.polish:
            fine[:1], _ = refine(finalists, current.cloud, reference.surface, p.refinement.fine_scales(), p.density.facing,
                                 p.refinement.damping, found)
            found = fit(fine[:1], current.cloud, reference.surface, p.density.facing)
    cloud = current.dense_cloud if p.refinement.polish else current.cloud
    if cloud is not current.cloud:
        found = fit(fine[:1], cloud, reference.surface, p.density.facing)
    fine[0], found = polish(fine[0], found, cloud, p.refinement)
    return decide(fine, fine_score, overlap, found.thinned(p.density.points), coarse.candidates, coarse.score, reference, current, p)


class Ranking(NamedTuple):
    """Refined hypotheses, best first.

    Attributes
    ----------
    candidates : (H, 3) array
    score, overlap : (H,) arrays
        As from `selection.score`.
    equations : (H, 4, 4) array
        The normal equations of the last iteration.
    best : Fit
        Of the best, H = 1.
    """

    candidates: np.ndarray
    score: np.ndarray
    overlap: np.ndarray
    equations: np.ndarray
    best: Fit

    def joined(self, other):
        """These and others."""
        best = self.best if self.score[0] >= other.score[0] else other.best
        parts = [np.concatenate(each) for each in zip(self[:-1], other[:-1], strict=True)]
        order = (-parts[1]).argsort(kind='stable')
        return Ranking(*(part[order] for part in parts), best)


def approach(candidates, known, cloud, reference, current, p, prior):
    """The coarse refinement, once more for all hypotheses where the best has come from far and not arrived: as `improve`."""
    scales = p.refinement.coarse_scales()
    coarse = improve(candidates, known, cloud, scales, reference, current, p, prior)
    if prior is not None:
        return coarse
    way = next_step(coarse.best, current.cloud, p.refinement.fine_scale, p.refinement.damping)
    if math.hypot(way[0], way[1]) < p.refinement.final_scale:
        return coarse
    # Some go past the place: those from before stay.
    return coarse.joined(improve(coarse.candidates, None, current.cloud, scales, reference, current, p, prior))


def improve(candidates, known, cloud, scales, reference, current, p, prior, both_ways=False):
    """Refine all hypotheses, whose `Fit` may be `known`, together by the points of a cloud, and score them by all points."""
    candidates, equations = refine(candidates, cloud, reference.surface, scales, p.density.facing, p.refinement.damping, known)
    fits = fit(candidates, current.cloud, reference.surface, p.density.facing)
    value, overlap = score(fits, reference, current, p.refinement.score_scale, p.density)
    if both_ways:
        value = value - p.density.violation * reverse_violation(candidates, reference, current, p.density)
    if prior is not None:
        value = value - p.prior.weight * np.minimum(surprise(candidates, prior) / p.prior.limit ** 2, 1.0)
    order = (-value).argsort(kind='stable')
    return Ranking(candidates[order], value[order], overlap[order], equations[order], fits.select(slice(order[0], order[0] + 1)))


def follow_free_direction(candidates, equations, reference, current, p):
    """Where the normal equations leave a direction all but free, a better place along it joins as a further hypothesis."""
    angle, weak, strong = np.array([weakest_direction(each[:3, :3]) for each in equations]).T
    free = weak < p.free.ratio * strong
    if not free.any():
        return candidates
    slid = search_free_direction(candidates[free], angle[free], reference, current, p.free, p.density)
    return np.concatenate((candidates, slid[(slid != candidates[free]).any(axis=1)]))
