# SPDX-License-Identifier: Apache-2.0
"""What the points of a scan that is aligned with the map constrain."""
import cmath
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..features.records import Features
from ..geometry.se2 import DOF, SE2
from ..geometry.tolerance import TINY
from ..parameters.tree import Parameters
from ..registration.residuals import (
    NO_STEP,
    degenerate_rotation,
    degenerate_translation,
    normal_equations,
    own_jacobian,
    shared_information,
)
from .correspondences import Correspondences


class InitialAlignment(NamedTuple):
    """Pose of a scan from its registration to a single reference, from which the alignment with the map starts.

    Attributes
    ----------
    pose : SE2
        Pose of the scan in the odometry frame.
    direction : float or None [rad]
        Degenerate direction of the translation in the odometry frame; None if no direction is degenerate.
    rotation_unobservable : bool
        Whether the reference does not constrain the rotation.
    """

    pose: SE2
    direction: float | None = None
    rotation_unobservable: bool = False


def strengthened(information: NDArray[np.float64], features: Features, correspondences: Correspondences,
                  initial: InitialAlignment, p: Parameters) -> NDArray[np.float64]:
    """Strengthen the prior's `information` ``(3, 3)`` along degenerate motions.

    The points seem to constrain a degenerate motion, but mostly due to noise of their normals. To compensate, the
    prior's information is multiplied by the ratio of all information of the points to the part that both scans share.
    """
    _, weight = correspondences.match(NO_STEP, p.refinement.map_first_scale)
    rows, own = correspondences.rows[:DOF], _own_jacobian(features, correspondences.pose, correspondences)
    seeming, shared = normal_equations(rows, weight), shared_information(rows, weight, own)
    motions = [] if initial.direction is None else [degenerate_translation(initial.direction, shared, p.decision)]
    if initial.rotation_unobservable:
        motions.append(degenerate_rotation(seeming, shared, p.decision))
    strengthened = information
    for motion in motions:
        total, common = float(motion @ seeming @ motion), float(motion @ shared @ motion)
        ratio = total / max(common, _MIN_SHARED_RATIO * total) if total > 0.0 else 1.0
        gradient = information @ motion
        added = gradient[:, None] * gradient
        strengthened = strengthened + max(ratio - 1.0, 0.0) / max(float(motion @ gradient), TINY) * added
    return strengthened


def information_along(features: Features, pose: SE2, angle: float, p: Parameters) -> NDArray[np.float64]:
    """Return ``(P,)``: information of each point of a scan at `pose` about the translation along `angle` [rad].

    It is zero for points whose normal is nearly perpendicular to this direction.
    """
    points = features.oriented_points
    cosine = (points.normals * cmath.rect(1.0, pose.theta - angle)).real
    information = np.where(np.abs(cosine) < p.translation.min_crossing_sine, 0.0, points.sharpened(cosine) ** 2)
    return np.asarray(points.weighted(information))


def sees_new_surface(features: Features, pose: SE2, correspondences: Correspondences, angle: float,
                     p: Parameters) -> bool:
    """Whether points on surfaces that no key frame contains would constrain the translation along `angle` [rad].

    They must provide at least half of all information along this degenerate direction, because noise makes a few
    points of every wall seem new.
    """
    _, weight = correspondences.match(correspondences.step(pose), p.refinement.map_first_scale)
    information = information_along(features, pose, angle, p)
    new = float((1.0 - np.bincount(correspondences.index, weight, correspondences.size)) @ information)
    return new >= max(p.decision.min_information, 0.5 * float(information.sum()))


def _own_jacobian(features: Features, pose: SE2, correspondences: Correspondences) -> NDArray[np.float64]:
    """Return `own_jacobian` ``(3, M)`` of the points of the correspondences, with the scan at `pose`."""
    points = features.oriented_points
    normals = points.sharpened(points.normals).take(correspondences.index)
    return own_jacobian(normals, pose.theta, correspondences.rotated_points)


_MIN_SHARED_RATIO = 1e-3
"""At least this fraction of the points' information is assumed to be shared by both scans."""
