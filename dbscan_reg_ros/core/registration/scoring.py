# SPDX-License-Identifier: Apache-2.0
"""Pre-selection of hypotheses, and which of them are the same motion."""
import math

import numpy as np

from ..features.free_space import FreeSpaceProfile, in_front
from ..features.oriented_points import OrientedPoints
from ..features.points import sample
from ..geometry.array_types import BoolArray, FloatArray
from ..geometry.se2 import wrap
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
