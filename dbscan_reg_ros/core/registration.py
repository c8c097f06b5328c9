"""The registration of one scan onto another (Figure 13)."""
import numpy as np

from . import alignment
from .parameters import Parameters
from .records import Features, Hypothesis, Prior, Registration, Status
from .rotation import estimate_rotations, pair_weights
from .se2 import SE2, wrap
from .translation import estimate_translations


def register(reference: Features, current: Features, parameters: Parameters = Parameters(),
             prior: Prior | None = None) -> Registration:
    """Find the motion that lays the current scan onto the reference."""
    p = parameters
    rotations = estimate_rotations(reference.segments, current.segments, p.rotation)
    weights = pair_weights(reference.segments, current.segments, p.rotation)
    translations = estimate_translations(reference.segments, current.segments, rotations, weights, p.translation)
    candidates = translations.transform[:p.selection.candidates]
    if prior is not None:
        candidates = np.concatenate((prior.transform.as_array()[None], candidates))
    if not len(candidates):
        return Registration(SE2(), np.eye(3), Status.FAILED)
    candidates = sieve(candidates, reference, current, p)
    coarse = refine(candidates, reference, current, p.refinement.coarse_scale, p.refinement.fine_scale, p.refinement.coarse, p)
    coarse_score, _ = score(coarse, reference, current, p.refinement.fine_scale, p)
    order = np.argsort(-coarse_score, kind='stable')
    coarse, coarse_score = coarse[order], coarse_score[order]
    finalists = distinct(coarse, p.selection.finalists)
    fine = refine(coarse[finalists], reference, current, p.refinement.fine_scale, p.refinement.final_scale, p.refinement.fine, p)
    fine_score, support = score(fine, reference, current, p.refinement.fine_scale, p)
    fine_score = fine_score - reverse_violation(fine, reference, current, p)
    order = np.argsort(-fine_score, kind='stable')
    hyps = tuple(Hypothesis(SE2.from_array(fine[i]), float(fine_score[i]), 'lines') for i in order)
    best = order[0]
    return Registration(hyps[0].transform, np.eye(3) * 1e-4, Status.OK, float(support[best]), float(fine_score[best]), hyps)


def sieve(candidates, reference, current, p):
    cloud = current.cloud.thinned(p.selection.sieve_points)
    support, violation = alignment.sieve(candidates, cloud.x, cloud.y, reference.view, p.selection.sieve_tolerance)
    value = support - p.density.violation * violation
    order = np.argsort(-value, kind='stable')[:p.selection.refined]
    return candidates[order]


def refine(candidates, reference, current, first, last, count, p):
    scales = np.geomspace(first, last, count) if count else ()
    return alignment.refine(candidates, current.cloud, reference.surface, scales, _Align(p))


class _Align:
    def __init__(self, p):
        self.facing, self.reach, self.damping = p.density.facing, p.density.reach, p.refinement.damping


def score(candidates, reference, current, scale, p):
    cloud = current.cloud
    _, weight, *_ = alignment.residuals(candidates, cloud, reference.surface, scale, _Align(p))
    support = weight.sum(axis=1) / len(cloud)
    px, py, _, _ = alignment.transform_points(candidates, cloud.x, cloud.y)
    near = reference.view.near.take(reference.view.bins(px, py))
    violation = alignment.free_space_violation(np.hypot(px, py), near, 0.15).sum(axis=1) / len(cloud)
    return support - p.density.violation * violation, support


def reverse_violation(candidates, reference, current, p):
    inverse = np.array([SE2.from_array(c).inverse().as_array() for c in candidates])
    cloud = reference.cloud
    px, py, _, _ = alignment.transform_points(inverse, cloud.x, cloud.y)
    near = current.view.near.take(current.view.bins(px, py))
    return p.density.violation * alignment.free_space_violation(np.hypot(px, py), near, 0.15).sum(axis=1) / len(cloud)


def distinct(candidates, count):
    """First `count` that differ from all before them."""
    chosen = []
    for i, c in enumerate(candidates):
        if all(np.hypot(*(c[:2] - candidates[j][:2])) > 0.05 or abs(wrap(c[2] - candidates[j][2])) > 0.02 for j in chosen):
            chosen.append(i)
            if len(chosen) == count:
                break
    return chosen
