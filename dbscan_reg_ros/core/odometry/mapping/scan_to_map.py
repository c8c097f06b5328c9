# SPDX-License-Identifier: Apache-2.0
"""Where a scan lies among the key frames: aligned with all of them at once, and how well they hold it there."""
import cmath
from dataclasses import replace

import numpy as np

from ...features.records import Features
from ...geometry.se2 import SE2, turned
from ...parameters.tree import Parameters
from ...registration.degeneracy import is_corridor_like, weakest_direction, without_near_parallel
from ...registration.point_to_line import NO_STEP, normal_equations, shared_information
from ...registration.uncertainty import degenerate_rotation, degenerate_translation, match_covariance, own_jacobian
from .key_frame_window import Correspondences, KeyFrameWindow, align


def align_to_map(window: KeyFrameWindow, features: Features, pose: SE2, expected: SE2, known, free, turns, p: Parameters):
    """The pose of a scan among the key frames, and its partners there.

    Parameters
    ----------
    window : Window
    features : Features
    pose : SE2
        Where one key frame has it, in the odometry frame.
    expected : SE2
        Where a prior has it.
    known : (3, 3) array
        Information of the prior, in the frame of the scan; zero where it does not agree with the key frame.
    free : float or None [rad]
        A direction in the odometry frame along which the key frame leaves the translation free.
    turns : bool
        The key frame leaves the rotation free: it is left to the prior.

    Returns
    -------
    SE2
    Partners
    """
    scales, damping = p.refinement.window_scales(features.noise), p.refinement.damping
    strength = max(p.prior.point_sigma, features.noise) ** 2 * turned(known, expected.theta)
    if turns:
        pose = expected
    correspondences = _partners(window, pose, features, free, p)
    if free is not None or turns:
        strength = _stiffened(strength, features, pose, correspondences, free, turns, p)
    pose = align(correspondences, pose, expected, strength, scales[:-1], damping)
    # Points that lie close together have other partners soon, points far apart hardly.
    if len(features.oriented_points) > p.density.max_points or correspondences.moved(pose) > _STALE * p.density.cell_size:
        correspondences = _partners(window, pose, features, free, p)
    return align(correspondences, pose, expected, strength, scales[-1:], damping), correspondences


def _partners(window, pose, features, free, p):
    """`KeyFrameWindow.correspondences`, walls without the slant by which alone they would hold the scan along a direction, that is `free` [rad]."""
    correspondences = window.correspondences(pose, features.oriented_points, p.density)
    information = correspondences.equations(NO_STEP, p.refinement.map_first_scale)[:3, :3]
    if free is None:
        free, weak, strong = weakest_direction(information)
        if weak >= _HELD * strong:
            return correspondences
    if not is_corridor_like(information, free):
        return correspondences
    return replace(correspondences, rows=without_near_parallel(correspondences.rows, free, p.degeneracy.parallel_tolerance))


def _stiffened(strength, features, pose, correspondences, free, turns, p):
    """The `strength` of a prior, more along the direction that is `free` [rad], if any, and where the scan `turns` freely.

    Most of what the points seem to know of such a motion is noise of their normals. The prior counts for as many times
    more as all their information is more than what both scans agree on.
    """
    _, weight = correspondences.match(NO_STEP, p.refinement.map_first_scale)
    rows, own = correspondences.rows[:3], _own_derivatives(features, pose, correspondences)
    information, shared = normal_equations(rows, weight), shared_information(rows, weight, own)
    motions = [] if free is None else [degenerate_translation(free, shared, p.decision)]
    if turns:
        motions.append(degenerate_rotation(information, shared, p.decision))
    stiffened = strength
    for motion in motions:
        seeming, held = motion @ information @ motion, motion @ shared @ motion
        times = seeming / max(held, _LEAST_SHARED * seeming) if seeming > 0.0 else 1.0
        pull = strength @ motion
        stiffened = stiffened + max(times - 1.0, 0.0) / max(motion @ pull, 1e-12) * (pull[:, None] * pull)
    return stiffened


def alignment_uncertainty(features: Features, pose: SE2, correspondences: Correspondences, p: Parameters, free_way, rotation_unobservable):
    """Covariance ``(3, 3)`` of a scan's place at `pose`, in its own frame, and what holds it: `decision.match_covariance`."""
    error, weight = correspondences.match(correspondences.step(pose), p.refinement.score_scale)
    own = _own_derivatives(features, pose, correspondences)
    covariance, held = match_covariance(error, weight, correspondences.rows[:3], own, features.noise, p.decision, free_way, rotation_unobservable)
    return turned(covariance, -pose.theta), held


def facing(features: Features, pose: SE2, angle, p: Parameters):
    """``(P,)``: what each point of a scan at `pose` would hold of the motion along `angle` [rad], if it faces along it."""
    cloud = features.oriented_points
    along = (cloud.normals * cmath.exp(1j * (pose.theta - angle))).real
    return cloud.weighted(np.where(np.abs(along) < p.degeneracy.min_facing, 0.0, cloud.sharpened(along) ** 2))


def sees_new_surface(features: Features, pose: SE2, correspondences: Correspondences, angle, p: Parameters):
    """Whether points that no key frame knows would hold the motion along `angle` [rad], which the latest leaves free.

    They have to be most of those that face along it: noise makes a few of every wall seem to do so.
    """
    _, weight = correspondences.match(correspondences.step(pose), p.refinement.map_first_scale)
    faces = facing(features, pose, angle, p)
    new = float((1.0 - np.bincount(correspondences.index, weight, correspondences.size)) @ faces)
    return new >= max(p.decision.min_information, 0.5 * float(faces.sum()))


def _own_derivatives(features, pose, correspondences):
    """`own_jacobian` of the scan's points, one for each of the `correspondences`."""
    cloud = features.oriented_points
    return own_jacobian(cloud.sharpened(cloud.normals).take(correspondences.index), pose.theta, correspondences.rotated_points)


_HELD = 0.02
"""Share of the information across a direction from which on that along it is no matter of slants."""
_STALE = 0.25
"""Share of a cell of the table: a scan that has moved farther may have other partners."""
_LEAST_SHARED = 1e-3
"""Of the information that the points seem to have, at least so much is taken as shared."""
