# SPDX-License-Identifier: Apache-2.0
"""Covariance and observability of a registered motion."""
import cmath
import math
from typing import NamedTuple

import numpy as np

from ..geometry.array_types import ComplexArray, FloatArray
from ..parameters.registration import DecisionParameters
from .point_to_line import jacobian


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


def own_jacobian(normals: ComplexArray, theta: float, rotated_points: ComplexArray) -> FloatArray:
    """Return the `jacobian` ``(3, P)`` from the `normals` (complex) of the points, rotated by `theta` [rad]."""
    return jacobian((cmath.rect(1.0, theta) * normals).conj(), rotated_points)


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


def degenerate_rotation(information: FloatArray, shared: FloatArray, parameters: DecisionParameters) -> FloatArray:
    """Return ``(3,)``: a rotation of 1 rad, and the translation [m] coupled with it."""
    _, dx, dy = _rotation_information(shared, information, parameters)
    return np.array((dx, dy, 1.0))


PRIOR_INFORMATION = np.array((0.01, 0.01, 0.1))
"""Information about an unknown motion [1/m^2, 1/m^2, 1/rad^2]: standard deviations of 10 m and of pi [rad]."""
CORRIDOR_RATIO = 0.1
"""A corridor has less than this ratio of the information along its axis to the information in both directions."""
