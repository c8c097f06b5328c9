# SPDX-License-Identifier: Apache-2.0
"""Covariance and observability of a registered motion."""
import cmath
import math
from typing import NamedTuple

import numpy as np

from ..geometry.se2 import turned
from ..geometry.symmetric_matrix import inverse
from ..parameters.registration import DecisionParameters
from ..parameters.tree import Parameters
from .degeneracy import is_corridor_like, weakest_direction, without_near_parallel
from .point_to_line import jacobian, mean_square, normal_equations, shared_information


def uncertainty(candidate, found, cloud, noise, p: Parameters):
    """Covariance ``(3, 3)`` of a motion in the current sensor's frame, and what holds it, `Observability`.

    The information is that of the points of a `sampled_points` as they were `found` there, a `Fit`, each as uncertain as the points that
    fit are, at least the range `noise` [m].
    """
    rows, own = jacobian(found.normals[0], found.rotated_points[0]), own_jacobian(cloud.sharpened(cloud.normals), candidate[2], found.rotated_points[0])
    weight = cloud.weighted(found.weight(p.refinement.score_scale))[0]
    covariance, held = match_covariance(found.error[0], weight, rows, own, noise, p.decision)
    return turned(covariance, -candidate[2]), held


def own_jacobian(normals, theta, rotated_points):
    """``(3, P)`` `jacobian` by the points' own `normals` (complex), turned by `theta` [rad]."""
    return jacobian((cmath.exp(1j * theta) * normals).conj(), rotated_points)


def match_covariance(error, weight, rows, own, noise, parameters: DecisionParameters, free_way=False, rotation_unobservable=False):
    """As `uncertainty`, from the errors [m] of points, their weights and derivatives, and the noise [m] of a range.

    Parameters
    ----------
    error, weight : (P,) arrays
    rows, own : (3, P) arrays
        As for `shared_information`.
    free_way, free_turn : bool
        The latest key frame leaves the translation along a direction, or the rotation, free: others have to hold it beyond
        chance, or cannot.
    """
    information, shared = normal_equations(rows, weight), shared_information(rows, weight, own)
    angle, weak, _ = weakest_direction(shared)
    if weak < parameters.weak_prior_information and is_corridor_like(shared, angle):
        straight, own_straight = (without_near_parallel(each, angle, parameters.parallel_tolerance, of=rows) for each in (rows, own))
        shared = shared_information(straight, weight, own_straight)
    points = float(weight.sum())
    held = observability(information, shared, points, parameters)
    if free_way:
        chance = _chance(points) * (weakest_direction(information)[1] - held.weak)
        held = held._replace(weak=max(held.weak - chance, 0.0))
    if rotation_unobservable:
        held = held._replace(turn=0.0)
    return calibrated_covariance(information, shared, mean_square(error, weight) + noise ** 2, held, parameters), held


class Observability(NamedTuple):
    """What holds a motion.

    Attributes
    ----------
    angle : float [rad]
        The direction of the translation that is known least.
    weak : float
        Points that hold it.
    turn : float
        Points, as if 1 m away, that hold the rotation.
    """

    angle: float
    weak: float
    turn: float


def observability(information, shared, points, parameters: DecisionParameters) -> Observability:
    """What of the `information` ``(3, 3)`` of so many `points` is `shared` by both scans: noise on the normals holds nothing.

    Where only noise holds the rotation, as in a round room, a match turns to where that of both scans happens to agree.
    """
    angle, weak, _ = weakest_direction(shared)
    turn = _turn_information(shared, information, parameters)[0]
    noise = max(_turn_information(information, information, parameters)[0] - turn, 0.0)
    return Observability(angle, weak, max(turn - _chance(points) * noise, 0.0))


def _chance(points):
    """The share of what noise seems to hold in which so many `points` of two scans may agree by chance."""
    return _CHANCE * math.sqrt(_ALIKE / max(points, 1.0))


def _turn_information(shared, information, parameters):
    """Of the rotation, whatever the translation, and the translation along x and y [m/rad] that goes with it."""
    (xx, xy, _), (_, yy, _), _ = information.tolist()
    x, y, turn = shared[2].tolist()
    xx, yy = xx + parameters.min_information, yy + parameters.min_information
    determinant = xx * yy - xy * xy
    along, across = (xy * y - yy * x) / determinant, (xy * x - xx * y) / determinant
    return turn + along * x + across * y, along, across


def degenerate_translation(angle, shared, parameters: DecisionParameters):
    """``(3,)``: a way of 1 m along `angle` [rad], and the turn [rad] that goes with it by the `shared` information ``(3, 3)``.

    What is held as long as nothing turns, as the way along the wall of a round room is, may be free where it turns.
    """
    (xx, xy, x), (_, yy, y), (_, _, turn) = shared.tolist()
    c, s = math.cos(angle), math.sin(angle)
    turns = min(c * c * xx + 2.0 * c * s * xy + s * s * yy, turn) > parameters.min_information
    return np.array([c, s, -(x * c + y * s) / turn if turns else 0.0])


def degenerate_rotation(information, shared, parameters: DecisionParameters):
    """``(3,)``: a turn of 1 rad, and the way [m] that goes with it; arguments as for `calibrated_covariance`."""
    _, *way = _turn_information(shared, information, parameters)
    return np.array((*way, 1.0))


def calibrated_covariance(information, shared, variance, held: Observability, parameters: DecisionParameters):
    """Covariance of a motion from the information ``(3, 3)`` of its points, each with the `variance` [m^2].

    What holds a direction is the `shared` information ``(3, 3)``. Few points hold it less surely than their number says:
    their errors are not independent. What less than `min_information` hold is free.

    Returns
    -------
    (3, 3) array
    """
    variance = variance * parameters.covariance_scale
    known, _, known_turn = parameters.prior_information()
    posterior = information / variance
    posterior.flat[::4] += parameters.prior_information()
    covariance = inverse(posterior)
    along, free = degenerate_translation(held.angle, shared, parameters), 1.0 / known
    extra = free if held.weak < parameters.min_information else min(variance * parameters.few_points_scale / held.weak ** 2, free)
    covariance += extra * along[:, None] * along
    if held.turn < parameters.min_information:
        turn = degenerate_rotation(information, shared, parameters)
        covariance += turn[:, None] * turn / known_turn
    return covariance


_CHANCE = 3.0
"""So many standard deviations of noise may agree by chance."""


_ALIKE = 5.0
"""The normals of so many neighbours are made of the same points."""
