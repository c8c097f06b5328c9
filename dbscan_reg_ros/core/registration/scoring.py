# SPDX-License-Identifier: Apache-2.0
"""From many hypotheses to few: how well each lays the current scan onto the reference (section 2.3).

The current scan's points are looked up in the density of the reference, the cross term of the K-L divergence (Eq. 19) as
a likelihood field; points in space that the other scan saw to be free count against a hypothesis.
"""
import math

import numpy as np

from ..features.free_space import FreeSpaceProfile, in_front
from ..features.oriented_points import OrientedPoints, sample
from ..features.records import Features
from ..geometry.se2 import wrap
from ..geometry.symmetric_matrix import inverse
from ..parameters.odometry import PriorParameters
from ..parameters.registration import DensityParameters, SelectionParameters
from . import point_to_line


def preselect(candidates, cloud: OrientedPoints, view: FreeSpaceProfile, parameters: SelectionParameters, density: DensityParameters):
    """The hypotheses ``(C, 3)`` that lay a scan's points best onto the outline of the reference, at most `refined` of them.

    A table of candidates x beams: no surface is built for it.
    """
    if len(candidates) <= parameters.preselected:
        return candidates
    places = point_to_line.transform_points(candidates, sample(cloud, parameters.preselection_points).points)
    bins, radius = view.bins(places), np.abs(places)
    near, far = view.near.take(bins), view.far.take(bins)
    off = np.maximum(near - radius, radius - far)
    support = np.minimum(np.maximum(1.0 - off / parameters.preselection_tolerance, 0.0), 1.0)
    support *= near > 0.0
    support -= density.violation_weight * in_front(radius, near, parameters.preselection_tolerance)
    return candidates[(-support.sum(axis=1)).argsort(kind='stable')[:parameters.preselected]]


def promising(candidates, fits: point_to_line.Fit, scale, share):
    """The hypotheses ``(H, 3)`` with at least a `share` of the best one's support, and their fits.

    The support is the sum of the kernels of a `scale` [m] over the points (Eq. 16).
    """
    support = fits.weight(scale).sum(axis=1)
    kept = (support >= share * support.max()).nonzero()[0]
    return (candidates, fits) if len(kept) == len(candidates) else (candidates[kept], fits.select(kept))


def score(fit: point_to_line.Fit, reference: Features, current: Features, scale, parameters: DensityParameters):
    """How well each hypothesis explains the points of the current scan, whose `fit` to the reference it is.

    Returns
    -------
    score : (H,) array
        Weighted share of the points on the reference's surfaces less the share in its free space; at most 1.
    overlap : (H,) array
        Plain share of the points on the reference's surfaces.
    """
    weight = fit.weight(scale)
    violation = reference.free_space.violation(fit.places, current.sampled_points.tolerance(parameters.violation_tolerance))
    violation *= 1.0 - weight
    return (weight - parameters.violation_weight * violation) @ current.leverage, weight.sum(axis=1) / max(len(current.sampled_points), 1)


def reverse_violation(candidates, reference: Features, current: Features, parameters: DensityParameters):
    """Weighted share of the reference's points that lie in the current scan's free space, for each hypothesis."""
    away = reference.sampled_points.points - point_to_line.origins(candidates)
    places = np.exp(-1j * candidates[:, 2:]) * away
    return current.free_space.violation(places, reference.sampled_points.tolerance(parameters.violation_tolerance)) @ reference.leverage


def squared_mahalanobis(candidates, prior):
    """Squared Mahalanobis distance ``(H,)`` of each hypothesis from the prior, in the prior sensor's frame."""
    expected = prior.transform
    step = candidates - expected.as_array()
    c, s = np.cos(expected.theta), np.sin(expected.theta)
    error = np.array((c * step[:, 0] + s * step[:, 1], c * step[:, 1] - s * step[:, 0], wrap(step[:, 2])))
    return (error * (inverse(prior.covariance) @ error)).sum(axis=0)


def within_gate(candidates, prior, parameters: PriorParameters):
    """Which hypotheses ``(H, 3)`` lie within the limit of a prior."""
    reach, turn = parameters.gate * prior.translation_sigma, parameters.gate * prior.rotation_sigma
    return same(candidates, prior.transform.as_array(), reach, turn)


def distinct(candidates, count, distance, angle):
    """Indices of the first `count` hypotheses that differ from all chosen before them."""
    chosen, rows = [], candidates.tolist()
    for index, (x, y, theta) in enumerate(rows):
        if all(math.hypot(x - a, y - b) > distance or abs(wrap(theta - c)) > angle for a, b, c in map(rows.__getitem__, chosen)):
            chosen.append(index)
            if len(chosen) == count:
                break
    return chosen


def same(candidates, one, distance, angle):
    """Which hypotheses ``(H, 3)`` lie within `distance` [m] and `angle` [rad] of `one` ``(3,)``."""
    near = np.hypot(candidates[:, 0] - one[0], candidates[:, 1] - one[1]) <= distance
    return near & (np.abs(wrap(candidates[:, 2] - one[2])) <= angle)
