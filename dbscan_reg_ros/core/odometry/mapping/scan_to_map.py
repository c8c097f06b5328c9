# SPDX-License-Identifier: Apache-2.0
"""Scan-to-map alignment: registers a scan to all key frames at once, and estimates covariance and observability."""
import cmath
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...features.records import Features
from ...geometry.se2 import DOF, SE2, turned
from ...geometry.tolerance import TINY
from ...parameters.tree import Parameters
from ...registration.degeneracy import is_corridor_like, weakest_direction, without_near_parallel
from ...registration.point_to_line import NO_STEP, normal_equations, shared_information
from ...registration.uncertainty import (
    Observability,
    Residuals,
    degenerate_rotation,
    degenerate_translation,
    match_covariance,
    own_jacobian,
    parallel_motion,
)
from .correspondences import Correspondences, PosePrior, align, weighted_by_agreement
from .key_frame_window import KeyFrameWindow


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


def align_to_map(window: KeyFrameWindow, features: Features, initial: InitialAlignment, prior: PosePrior,
                 p: Parameters, coarse: KeyFrameWindow | None = None) -> tuple[SE2, Correspondences]:
    """Align a scan with all key frames of the window.

    Parameters
    ----------
    window : KeyFrameWindow
    features : Features
        Features of the scan.
    initial : InitialAlignment
        Result of the registration. If its rotation is unobservable, the alignment starts at the pose of the prior.
    prior : PosePrior
        Its information is in the frame of the scan [1/m^2, 1/rad^2], and zero if it contradicts `initial`.
    p : Parameters
    coarse : KeyFrameWindow, optional
        Key frames with which all iterations but the last align the scan; None: those of `window`. In the last
        iteration the others have the weights of `weighted_by_agreement`.

    Returns
    -------
    pose : SE2
        Pose of the scan in the odometry frame.
    correspondences : Correspondences
    """
    coarse = coarse or window
    scales, damping = p.refinement.window_scales(features.noise), p.refinement.damping
    noise = max(p.refinement.map_scale, features.noise)
    information = noise ** 2 * turned(prior.information, prior.pose.theta)
    pose = prior.pose if initial.rotation_unobservable else initial.pose
    correspondences = _correspondences(coarse, pose, features, initial.direction, p)
    if initial.direction is not None or initial.rotation_unobservable:
        information = _strengthened(information, features, correspondences, initial, p)
    prior = PosePrior(prior.pose, information)
    pose = align(correspondences, pose, prior, scales[:-1], damping)
    # The nearest lines of dense points change with small steps, those of sparse points hardly.
    is_dense = len(features.oriented_points) > p.density.max_points
    if (coarse is not window or is_dense
            or correspondences.mean_displacement(pose) > _MAX_DISPLACEMENT * p.density.cell_size):
        own, correspondences = correspondences, _correspondences(window, pose, features, initial.direction, p)
        if coarse is not window:
            correspondences = weighted_by_agreement(
                correspondences, own, window.is_in(coarse), p.refinement.map_first_scale, noise)
    return align(correspondences, pose, prior, scales[-1:], damping), correspondences


def _correspondences(window: KeyFrameWindow, pose: SE2, features: Features, direction: float | None,
                     p: Parameters) -> Correspondences:
    """Look up correspondences; near-parallel walls count as parallel to the degenerate `direction` [rad].

    If `direction` is None, the least constrained direction is used instead, if it is weakly constrained.
    """
    correspondences = window.correspondences(pose, features.oriented_points, p.density)
    information = correspondences.equations(NO_STEP, p.refinement.map_first_scale)[:DOF, :DOF]
    if direction is None:
        direction, weak, strong = weakest_direction(information)
        if weak >= _WELL_CONSTRAINED * strong:
            return correspondences
    if not is_corridor_like(information, direction):
        return correspondences
    motion = parallel_motion(direction, information, p.decision)
    rows = without_near_parallel(correspondences.rows, motion, p.degeneracy.parallel_tolerance)
    return replace(correspondences, rows=rows)


def _strengthened(information: NDArray[np.float64], features: Features, correspondences: Correspondences,
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


def alignment_uncertainty(features: Features, pose: SE2, correspondences: Correspondences, initial: InitialAlignment,
                          p: Parameters) -> tuple[NDArray[np.float64], Observability]:
    """Estimate covariance and observability of a scan aligned at `pose`.

    Returns
    -------
    covariance : (3, 3) float
        Covariance in the frame of the scan [m, m, rad].
    observability : Observability
        Observability; its direction is in the odometry frame.
    """
    error, weight = correspondences.match(correspondences.step(pose), p.refinement.score_scale)
    own = _own_jacobian(features, pose, correspondences)
    residuals = Residuals(error, weight, correspondences.rows[:DOF], own, features.noise)
    return match_covariance(
        residuals, p.decision, pose.theta, initial.direction is not None, initial.rotation_unobservable)


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


_WELL_CONSTRAINED = 0.02
"""A direction is well constrained if its information is at least this fraction of the information across it."""
_MAX_DISPLACEMENT = 0.25
"""If the points move by more than this ratio of the cell size on average, correspondences are looked up again."""
_MIN_SHARED_RATIO = 1e-3
"""At least this fraction of the points' information is assumed to be shared by both scans."""
