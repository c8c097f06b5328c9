# SPDX-License-Identifier: Apache-2.0
"""The registration of one scan onto another (Figure 13)."""
import dataclasses
import math
from typing import NamedTuple

import numpy as np

from ..errors import ScanError
from ..features.extraction import extract_features
from ..features.oriented_points import sample
from ..features.records import Features
from ..parameters.tree import Parameters
from ..scan import Scan
from .clustering import choose_clustering
from .degeneracy import search_degenerate_direction, weakest_direction
from .landmarks import landmark_motions
from .paper.divergence import select_by_divergence
from .point_to_line import Fit, fit, next_step, polish, refine
from .records import Prior, Registration, Status
from .rotation import estimate_rotations, pair_weights
from .scoring import distinct, preselect, promising, reverse_violation, score, squared_mahalanobis, within_gate
from .status import decide, failed
from .translation import estimate_translations


def register(reference: Scan | Features, current: Scan | Features, parameters: Parameters = Parameters(),
             prior: Prior | None = None, near: bool = True) -> Registration:
    """Find the motion that lays the current scan onto the reference; no initial guess is needed.

    Parameters
    ----------
    reference, current : Scan or Features
        The earlier and the later scan, or what `extract_features` made of them. Features made once serve several
        registrations.
    parameters : Parameters
    prior : Prior, optional
        One more hypothesis, in the reference's frame.
    near : bool
        Look first at what the prior does not rule out. It costs time where the rest has to be looked at after all.

    Returns
    -------
    Registration
        ``p_R = transform.apply(p_O)`` (Eq. 8): the pose of the sensor at the current scan in the reference's frame.

    Raises
    ------
    ScanError
        When a scan holds too few returns, or is neither a `Scan` nor `Features`.
    """
    reference, current = (_features(each, parameters) for each in (reference, current))
    p = parameters
    if current.oriented_points.inverse_noise is not None and not reference.noise_ratio:
        # Of the same sensor: noise of far ranges that one scan alone shows is chance, or outliers.
        current = dataclasses.replace(current, noise_ratio=0.0)
    weights = pair_weights(reference.segments, current.segments, p.rotation)
    rotations = estimate_rotations(reference.segments, current.segments, weights, p.rotation)
    if near and prior is not None and p.selection.method == 'density':
        found = search_within_gate(prior, reference, current, rotations, weights, p, p.prior.max_score_outside_gate)
        if found is not None:
            return found
    translations = estimate_translations(reference.segments, current.segments, rotations, weights, p.translation)
    if p.selection.method == 'divergence':
        return select_by_divergence(reference, current, rotations, translations, p)
    sure, most = translations.shortest, p.selection.max_clusters
    if prior is not None:
        sure, most = np.concatenate((prior.transform.as_array()[None], sure)), p.selection.max_clusters_with_prior
    candidates = translations.transform[:most]
    if p.selection.max_landmarks and p.selection.wide_search_factor == 1:
        candidates = np.concatenate((landmark_motions(reference, current, p, prior), candidates))
    found = select(sure, candidates, reference, current, p, prior)
    doubtful = found.score < p.selection.wide_search_score or prior is None and found.status is not Status.OK
    if doubtful and p.selection.wide_search_factor > 1:
        wide = register(reference, current, p.widened, prior, near=False)
        if wide.score > found.score + p.selection.wide_search_gain:
            return wide
    return found


def _features(scan: Scan | Features, parameters: Parameters) -> Features:
    """The features of a scan that may have been made already."""
    if isinstance(scan, Features):
        return scan
    if isinstance(scan, Scan):
        return extract_features(scan, parameters)
    raise ScanError(f'a {type(scan).__name__} cannot be registered; expected Scan or Features: Scan.from_ranges(ranges, angles)')


def register_within_gate(reference: Features, current: Features, parameters: Parameters, prior: Prior) -> Registration:
    """The best of what the prior does not rule out, however well others may fit: as `register`."""
    weights = pair_weights(reference.segments, current.segments, parameters.rotation)
    rotations = estimate_rotations(reference.segments, current.segments, weights, parameters.rotation)
    return search_within_gate(prior, reference, current, rotations, weights, parameters, -np.inf)


def search_within_gate(prior, reference, current, rotations, weights, p, least):
    """The best of what the prior does not rule out; None where it scores no more than `least`."""
    expected = prior.transform.as_array()
    near = rotations.near(expected[2], p.prior.gate * prior.rotation_sigma)
    translations = estimate_translations(reference.segments, current.segments, near, weights, p.translation)
    candidates = translations.transform
    candidates = candidates[within_gate(candidates, prior, p.prior)]
    return select(expected[None], candidates[:p.selection.max_clusters_with_prior], reference, current, p, prior, least)


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
    if not len(current.sampled_points):
        return failed('no returns of the scan lie on a surface')
    if prior is None:
        # Most hypotheses are far off: a part of the points tells which, and leads the others close enough.
        cloud, candidates = sample(current.sampled_points, p.selection.preselection_points), np.concatenate((sure, candidates))
        candidates, found = promising(candidates, fit(candidates, cloud, reference.likelihood_field, p.density.min_normal_cosine),
                                    p.refinement.coarse_scale, p.selection.min_support_ratio)
    else:
        cloud, found = current.sampled_points, None
        candidates = np.concatenate((sure, preselect(candidates, cloud, reference.free_space, p.selection, p.density)))
    coarse = approach(candidates, found, cloud, reference, current, p, prior)
    if coarse.score[0] <= least:
        return None
    chosen = distinct(coarse.candidates, p.selection.top_candidates, p.selection.same_distance, p.selection.same_angle)
    close = [each for each in chosen if coarse.score[each] >= coarse.score[0] - p.selection.max_score_gap]
    finalists = follow_degenerate_direction(coarse.candidates[close], coarse.equations[close], reference, current, p)
    if len(finalists) > 1:
        fine, fine_score, overlap, _, found = improve(
            finalists, None, current.sampled_points, p.refinement.fine_scales(), reference, current, p, prior, both_ways=True)
        if fine_score[0] <= least:
            return None
    else:
        fine, fine_score, overlap, found = coarse.candidates[chosen], coarse.score[chosen], coarse.overlap[chosen], coarse.best
        if not p.refinement.polish_iterations:
            fine[:1], _ = refine(finalists, current.sampled_points, reference.likelihood_field, p.refinement.fine_scales(), p.density.min_normal_cosine,
                                 p.refinement.damping, found)
            found = fit(fine[:1], current.sampled_points, reference.likelihood_field, p.density.min_normal_cosine)
    cloud = current.oriented_points if p.refinement.polish_iterations else current.sampled_points
    if cloud is not current.sampled_points:
        found = fit(fine[:1], cloud, reference.likelihood_field, p.density.min_normal_cosine)
    fine[0], found = polish(fine[0], found, cloud, p.refinement)
    return decide(fine, fine_score, overlap, found.thinned(p.density.max_points), coarse.candidates, coarse.score, reference, current, p)


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
    way = next_step(coarse.best, current.sampled_points, p.refinement.fine_scale, p.refinement.damping)
    if math.hypot(way[0], way[1]) < p.refinement.final_scale:
        return coarse
    # Some go past the place: those from before stay.
    return coarse.joined(improve(coarse.candidates, None, current.sampled_points, scales, reference, current, p, prior))


def improve(candidates, known, cloud, scales, reference, current, p, prior, both_ways=False):
    """Refine all hypotheses, whose `Fit` may be `known`, together by the points of a cloud, and score them by all points."""
    candidates, equations = refine(candidates, cloud, reference.likelihood_field, scales, p.density.min_normal_cosine, p.refinement.damping, known)
    fits = fit(candidates, current.sampled_points, reference.likelihood_field, p.density.min_normal_cosine)
    value, overlap = score(fits, reference, current, p.refinement.score_scale, p.density)
    if both_ways:
        value = value - p.density.violation_weight * reverse_violation(candidates, reference, current, p.density)
    if prior is not None:
        value = value - p.prior.weight * np.minimum(squared_mahalanobis(candidates, prior) / p.prior.gate ** 2, 1.0)
    order = (-value).argsort(kind='stable')
    return Ranking(candidates[order], value[order], overlap[order], equations[order], fits.select(slice(order[0], order[0] + 1)))


def follow_degenerate_direction(candidates, equations, reference, current, p):
    """Where the normal equations leave a direction all but free, a better place along it joins as a further hypothesis."""
    angle, weak, strong = np.array([weakest_direction(each[:3, :3]) for each in equations]).T
    free = weak < p.degeneracy.information_ratio * strong
    if not free.any():
        return candidates
    slid = search_degenerate_direction(candidates[free], angle[free], reference, current, p.degeneracy, p.density)
    return np.concatenate((candidates, slid[(slid != candidates[free]).any(axis=1)]))


def load_strategies(parameters: Parameters) -> None:
    """Import what the `parameters` choose, so that the first registration does not wait for it.

    Raises
    ------
    ParameterError
        When a package that they need is not installed.
    """
    choose_clustering(parameters.rotation.clustering)
    choose_clustering(parameters.translation.clustering)
