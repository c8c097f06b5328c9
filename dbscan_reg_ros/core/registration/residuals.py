# SPDX-License-Identifier: Apache-2.0
"""Residuals of a scan's points on the lines of a reference, and what they constrain."""
from typing import NamedTuple

import numpy as np

from ..features.likelihood_field import LikelihoodField
from ..features.oriented_points import OrientedPoints


class Alignment(NamedTuple):
    """Points, likelihood field and settings with which candidates are refined.

    Attributes
    ----------
    points : OrientedPoints
        Points of the current scan.
    field : LikelihoodField
        Likelihood field of the reference.
    damping : float
        Damping of a step, as in `solve_step`; it keeps candidates from moving in an unobservable direction.
    """

    points: OrientedPoints
    field: LikelihoodField
    damping: float


class Observability(NamedTuple):
    """How well points constrain a motion.

    Attributes
    ----------
    angle : float [rad]
        Direction in which the translation is constrained least.
    weak : float
        Effective number of points that constrain the translation along that direction.
    rotation : float
        Effective number of points that constrain the rotation, converted to points at a distance of 1 m.
    """

    angle: float
    weak: float
    rotation: float


PRIOR_INFORMATION = np.array((0.01, 0.01, 0.1))
"""Information about an unknown motion [1/m^2, 1/m^2, 1/rad^2]: standard deviations of 10 m and of pi [rad]."""
CORRIDOR_RATIO = 0.1
"""A corridor has less than this ratio of the information along its axis to the information in both directions."""
