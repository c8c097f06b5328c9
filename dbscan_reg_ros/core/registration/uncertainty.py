# SPDX-License-Identifier: Apache-2.0
"""Covariance and observability of a registered motion."""
import cmath
import math
from typing import NamedTuple

import numpy as np

from ..features.oriented_points import OrientedPoints
from ..geometry.array_types import ComplexArray, FloatArray
from ..geometry.se2 import DOF, turned
from ..geometry.symmetric_matrix import inverse
from ..geometry.tolerance import SIGMAS
from ..parameters.registration import DecisionParameters
from ..parameters.tree import Parameters
from .degeneracy import CORRIDOR_RATIO, is_corridor_like, weakest_direction, without_near_parallel
from .point_to_line import Fit, jacobian, mean_square, normal_equations, shared_information


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


class Residuals(NamedTuple):
    """Residuals of P points of a registered scan.

    Attributes
    ----------
    error : (P,) float [m]
    weight : (P,) float
    rows, own : (3, P) float
        `jacobian` computed with the normals of the lines, and with those of the points; see `shared_information`.
    noise : float [m]
        Standard deviation of a range.
    """

    error: FloatArray
    weight: FloatArray
    rows: FloatArray
    own: FloatArray
    noise: float


def uncertainty(candidate: FloatArray, found: Fit, points: OrientedPoints, noise: float,
                p: Parameters) -> tuple[FloatArray, Observability]:
    """Return the covariance ``(3, 3)`` of a motion in the current sensor's frame, and its `Observability`.

    Parameters
    ----------
    candidate : (3,) array
    found : Fit
        Fit of the `points` for this candidate.
    points : OrientedPoints
        Points of the current scan.
    noise : float [m]
        Standard deviation of a range, which is added to the spread of the errors.
    p : Parameters
    """
    rows = jacobian(found.normals[0], found.rotated_points[0])
    own = own_jacobian(points.sharpened(points.normals), float(candidate[2]), found.rotated_points[0])
    weight = points.weighted(found.weight(p.refinement.score_scale))[0]
    residuals = Residuals(found.error[0], weight, rows, own, noise)
    return match_covariance(residuals, p.decision, float(candidate[2]))


def own_jacobian(normals: ComplexArray, theta: float, rotated_points: ComplexArray) -> FloatArray:
    """Return the `jacobian` ``(3, P)`` from the `normals` (complex) of the points, rotated by `theta` [rad]."""
    return jacobian((cmath.rect(1.0, theta) * normals).conj(), rotated_points)


def match_covariance(residuals: Residuals, parameters: DecisionParameters, theta: float,
                     latest_degenerate: bool = False,
                     rotation_unobservable: bool = False) -> tuple[FloatArray, Observability]:
    """Return the covariance ``(3, 3)`` of a match in the frame of the scan, and its `Observability`.

    Parameters
    ----------
    residuals : Residuals
    parameters : DecisionParameters
    theta : float [rad]
        Rotation of the scan in the frame of the residuals.
    latest_degenerate : bool
        Whether the translation relative to the latest key frame is degenerate: older key frames then have to constrain
        it by more than noise could by chance.
    rotation_unobservable : bool
        Whether the rotation counts as unobservable regardless of the residuals.
    """
    error, weight, _, _, noise = residuals
    information, shared = informations(residuals, parameters)
    count = float(weight.sum())
    observed = observability(information, shared, count, parameters)
    if latest_degenerate:
        chance = _chance_ratio(count) * (weakest_direction(information)[1] - observed.weak)
        observed = observed._replace(weak=max(observed.weak - chance, 0.0))
    if rotation_unobservable:
        observed = observed._replace(rotation=0.0)
    variance = mean_square(error, weight) + noise ** 2
    covariance = calibrated_covariance(information, shared, variance, observed, parameters)
    return turned(covariance, -theta), observed


def informations(residuals: Residuals, parameters: DecisionParameters) -> tuple[FloatArray, FloatArray]:
    """Return the information ``(3, 3)`` of all points, and the part of it that both scans share."""
    _, weight, rows, own, _ = residuals
    shared = shared_information(rows, weight, own)
    angle, weak, _ = weakest_direction(shared)
    if weak < parameters.weak_prior_information and is_corridor_like(shared, angle):
        motion = parallel_motion(angle, shared, parameters)
        parallel, own_parallel = (without_near_parallel(each, motion, parameters.parallel_tolerance, of=rows)
                                  for each in (rows, own))
        shared = shared_information(parallel, weight, own_parallel)
    return normal_equations(rows, weight), shared


def observability(information: FloatArray, shared: FloatArray, count: float,
                  parameters: DecisionParameters) -> Observability:
    """Return the observability of a motion from the `shared` part ``(3, 3)`` of the `information` of `count` points.

    Noise of the normals constrains nothing. In a circular room, where only noise constrains the rotation, a match
    rotates to where the noise of both scans agrees by chance: the information of such chance agreement is subtracted.
    """
    angle, weak, _ = weakest_direction(shared)
    rotation = _rotation_information(shared, information, parameters)[0]
    noise = max(_rotation_information(information, information, parameters)[0] - rotation, 0.0)
    return Observability(angle, weak, max(rotation - _chance_ratio(count) * noise, 0.0))


def _chance_ratio(count: float) -> float:
    """Return the fraction of the noise information that `count` points of two scans may share by chance."""
    return SIGMAS * math.sqrt(_DEPENDENT / max(count, 1.0))


def _rotation_information(shared: FloatArray, information: FloatArray,
                          parameters: DecisionParameters) -> tuple[float, float, float]:
    """Return the information about the rotation, and the translation (x, y) [m/rad] that compensates it best."""
    (xx, xy, _), (_, yy, _), _ = information.tolist()
    x, y, rotation = shared[2].tolist()
    xx, yy = xx + parameters.min_information, yy + parameters.min_information
    determinant = xx * yy - xy * xy
    dx, dy = (xy * y - yy * x) / determinant, (xy * x - xx * y) / determinant
    return rotation + dx * x + dy * y, dx, dy


def degenerate_translation(angle: float, shared: FloatArray, parameters: DecisionParameters) -> FloatArray:
    """Return ``(3,)``: a translation of 1 m along `angle` [rad], and the rotation [rad] coupled with it.

    A direction may be degenerate only together with a rotation, as along the wall of a circular room. The rotation
    follows from the `shared` information ``(3, 3)``.
    """
    (xx, xy, x), (_, yy, y), (_, _, rotation) = shared.tolist()
    c, s = math.cos(angle), math.sin(angle)
    rotates = min(c * c * xx + 2.0 * c * s * xy + s * s * yy, rotation) > parameters.min_information
    return np.array([c, s, -(x * c + y * s) / rotation if rotates else 0.0])


def parallel_motion(angle: float, information: FloatArray, parameters: DecisionParameters) -> FloatArray:
    """Return ``(3,)``: the motion along a corridor in the direction `angle` [rad], to which its walls are parallel.

    It is a translation of 1 m. If an arc (with a rotation) is much less constrained than the straight translation, the
    corridor is curved, and the arc is returned.
    """
    arc = degenerate_translation(angle, information, parameters)
    straight = arc * (1.0, 1.0, 0.0)
    is_curved = arc @ information @ arc < CORRIDOR_RATIO * (straight @ information @ straight)
    return arc if is_curved else straight


def degenerate_rotation(information: FloatArray, shared: FloatArray, parameters: DecisionParameters) -> FloatArray:
    """Return ``(3,)``: a rotation of 1 rad, and the translation [m] coupled with it."""
    _, dx, dy = _rotation_information(shared, information, parameters)
    return np.array((dx, dy, 1.0))


def calibrated_covariance(information: FloatArray, shared: FloatArray, variance: float, observed: Observability,
                          parameters: DecisionParameters) -> FloatArray:
    """Return the covariance ``(3, 3)`` of a motion from the information of its points.

    If few points constrain a direction, its variance is increased, because their errors are not independent. A
    direction constrained by fewer than `decision.min_information` points gets the variance of an unknown motion.

    Parameters
    ----------
    information, shared : (3, 3) arrays
        Information of all points, and the part of it that both scans share.
    variance : float [m^2]
        Variance of the distance of a point from its line.
    observed : Observability
    parameters : DecisionParameters
    """
    variance = variance * parameters.covariance_scale
    posterior = information / variance
    posterior.flat[::DOF + 1] += PRIOR_INFORMATION
    covariance: FloatArray = inverse(posterior)
    along, unknown = degenerate_translation(observed.angle, shared, parameters), 1.0 / PRIOR_INFORMATION[0]
    extra = unknown
    if observed.weak >= parameters.min_information:
        extra = min(variance * parameters.few_points_scale / observed.weak ** 2, unknown)
    covariance += extra * along[:, None] * along
    if observed.rotation < parameters.min_information:
        rotation = degenerate_rotation(information, shared, parameters)
        covariance += rotation[:, None] * rotation / PRIOR_INFORMATION[-1]
    return covariance


PRIOR_INFORMATION = np.array((0.01, 0.01, 0.1))
"""Information about an unknown motion [1/m^2, 1/m^2, 1/rad^2]: standard deviations of 10 m and of pi [rad]."""
_DEPENDENT = 5.0
"""Number of neighbouring points whose normals are correlated."""
