# SPDX-License-Identifier: Apache-2.0
"""Scores of hypotheses: how well each aligns the current scan with the reference (section 2.3).

The current scan's points are looked up in the density of the reference, the cross term of the K-L divergence (Eq. 19)
as a likelihood field. Points of one scan in free space of the other count against a hypothesis.
"""
import math

import numpy as np

from ..features.free_space import FreeSpaceProfile, in_front
from ..features.oriented_points import OrientedPoints
from ..features.points import sample
from ..features.records import Features
from ..geometry.array_types import BoolArray, FloatArray
from ..geometry.se2 import unit_complex, wrap
from ..geometry.symmetric_matrix import inverse
from ..geometry.ties import order_up_to_rounding
from ..parameters.odometry import PriorParameters
from ..parameters.registration import DensityParameters, SelectionParameters
from . import point_to_line
from .records import Prior


def preselect(candidates: FloatArray, points: OrientedPoints, profile: FreeSpaceProfile,
              parameters: SelectionParameters, density: DensityParameters) -> FloatArray:
    """Return the hypotheses that align a scan best with the outline of the reference, at most `selection.preselected`.

    Only the free-space profile of the reference is looked up, not its likelihood field.

    Parameters
    ----------
    candidates : (C, 3) array
    points : OrientedPoints
        Points of the current scan.
    profile : FreeSpaceProfile
        Free-space profile of the reference.
    parameters : SelectionParameters
    density : DensityParameters
    """
    if len(candidates) <= parameters.preselected:
        return candidates
    places = point_to_line.transform_points(candidates, sample(points, parameters.preselection_points).points)
    bins, radius = profile.bins(places), np.abs(places)
    near, far = profile.near.take(bins), profile.far.take(bins)
    off = np.maximum(near - radius, radius - far)
    support = np.minimum(np.maximum(1.0 - off / parameters.preselection_tolerance, 0.0), 1.0)
    support *= near > 0.0
    support -= density.violation_weight * in_front(radius, near, parameters.preselection_tolerance)
    chosen: FloatArray = candidates[order_up_to_rounding(-support.sum(axis=1))[:parameters.preselected]]
    return chosen


def promising(candidates: FloatArray, fits: point_to_line.Fit, scale: float,
              min_ratio: float) -> tuple[FloatArray, point_to_line.Fit]:
    """Return the hypotheses ``(H, 3)`` with at least `min_ratio` of the largest support, and their fits.

    The support is the sum of the kernels of `scale` [m] over the points (Eq. 16).
    """
    support = fits.weight(scale).sum(axis=1)
    kept = (support >= min_ratio * support.max()).nonzero()[0]
    return (candidates, fits) if len(kept) == len(candidates) else (candidates[kept], fits.select(kept))


def score(fits: point_to_line.Fit, reference: Features, current: Features, scale: float,
          parameters: DensityParameters) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute the score of each hypothesis from the points of the current scan.

    Parameters
    ----------
    fits : Fit
        Fits of the current scan's `sampled_points` to the reference.
    reference, current : Features
    scale : float [m]
        Scale of the kernel.
    parameters : DensityParameters

    Returns
    -------
    score : (H,) array
        Weighted fraction of the points on the reference's surfaces minus `violation_weight` times the weighted fraction
        in its free space; at most 1.
    overlap : (H,) array
        Unweighted fraction of the points on the reference's surfaces.
    conflict : (H,) array
        Weighted fraction of the points in the reference's free space.
    """
    weight, points = fits.weight(scale), current.sampled_points
    violation = reference.free_space.violation(fits.places, points.tolerance(parameters.violation_tolerance))
    conflict: FloatArray = violation @ current.leverage
    violation *= 1.0 - weight
    value: FloatArray = (weight - parameters.violation_weight * violation) @ current.leverage
    return value, weight.sum(axis=1) / max(len(points), 1), conflict


def reverse_violation(candidates: FloatArray, reference: Features, current: Features,
                      parameters: DensityParameters) -> FloatArray:
    """Return the weighted fraction ``(H,)`` of the reference's points in free space of the current scan."""
    points = reference.sampled_points
    away = points.points - point_to_line.origins(candidates)
    places = unit_complex(-candidates[:, 2:]) * away
    violation = current.free_space.violation(places, points.tolerance(parameters.violation_tolerance))
    fraction: FloatArray = violation @ reference.leverage
    return fraction


def squared_mahalanobis(candidates: FloatArray, prior: Prior) -> FloatArray:
    """Return the squared Mahalanobis distance ``(H,)`` of each hypothesis from the prior, in the sensor's frame."""
    expected = prior.transform
    step = candidates - expected.as_array()
    c, s = np.cos(expected.theta), np.sin(expected.theta)
    error = np.array((c * step[:, 0] + s * step[:, 1], c * step[:, 1] - s * step[:, 0], wrap(step[:, 2])))
    distance: FloatArray = (error * (inverse(prior.covariance) @ error)).sum(axis=0)
    return distance


def within_gate(candidates: FloatArray, prior: Prior, parameters: PriorParameters) -> BoolArray:
    """Whether each hypothesis ``(H, 3)`` lies within `prior.gate` standard deviations of a prior."""
    distance, angle = parameters.gate * prior.translation_sigma, parameters.gate * prior.rotation_sigma
    return same(candidates, prior.transform.as_array(), distance, angle)


def distinct(candidates: FloatArray, count: int, distance: float, angle: float) -> list[int]:
    """Return the indices of the first `count` hypotheses ``(H, 3)`` that differ from all hypotheses chosen before.

    Two hypotheses differ if they are more than `distance` [m] or more than `angle` [rad] apart.
    """
    chosen: list[int] = []
    rows = candidates.tolist()
    for index, (x, y, theta) in enumerate(rows):
        if all(math.hypot(x - a, y - b) > distance or abs(wrap(theta - c)) > angle
               for a, b, c in map(rows.__getitem__, chosen)):
            chosen.append(index)
            if len(chosen) == count:
                break
    return chosen


def same(candidates: FloatArray, one: FloatArray, distance: float, angle: float) -> BoolArray:
    """Whether each hypothesis ``(H, 3)`` lies within `distance` [m] and `angle` [rad] of `one` ``(3,)``."""
    near = np.hypot(candidates[:, 0] - one[0], candidates[:, 1] - one[1]) <= distance
    within: BoolArray = near & (np.abs(wrap(candidates[:, 2] - one[2])) <= angle)
    return within
