# SPDX-License-Identifier: Apache-2.0
"""Residuals of a scan's points on the lines of a reference, and what they constrain."""
from typing import NamedTuple

import numpy as np

from ..features.likelihood_field import LikelihoodField
from ..features.oriented_points import OrientedPoints, spacing
from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.robust_kernel import kernel
from ..geometry.se2 import DOF, unit_complex


def origins(candidates: FloatArray) -> ComplexArray:
    """Return the position ``(H, 1)`` (complex [m]) of the sensor for each candidate ``(H, 3)``."""
    positions: ComplexArray = candidates[:, :2].copy().view(np.complex128)
    return positions


def transform_points(candidates: FloatArray, points: ComplexArray) -> ComplexArray:
    """Return the points ``(H, P)`` (complex [m]), rotated and translated by every candidate ``(H, 3)`` (Eq. 8)."""
    moved: ComplexArray = unit_complex(candidates[:, 2:]) * points + origins(candidates)
    return moved


class Fit(NamedTuple):
    """Correspondences of a scan's P points with lines of the reference, for each of H candidates.

    Attributes
    ----------
    error : (H, P) float [m]
        Signed distance of each point from the line of the nearest reference point, times the point's `inverse_noise`.
    alike : (H, P) bool
        Whether the normals of point and line agree.
    normals : (H, P) complex
        Conjugated normal of the line, times the `inverse_noise` of the scan's point.
    rotated_points : (H, P) complex [m]
        Rotated points.
    places : (H, P) complex [m]
        Rotated and translated points.
    """

    error: FloatArray
    alike: BoolArray
    normals: ComplexArray
    rotated_points: ComplexArray
    places: ComplexArray

    def weight(self, scale: float) -> FloatArray:
        """Return ``(H, P)``: Gaussian kernel of `scale` [m] of the distances (Eq. 18), 0 where the normals disagree."""
        weight: FloatArray = kernel(self.error, scale)
        weight *= self.alike
        return weight

    def rows(self) -> FloatArray:
        """Return the `linear_residuals` ``(H, 4, P)``."""
        return linear_residuals(self.error, self.normals, self.rotated_points)

    def select(self, chosen: IntArray | slice) -> 'Fit':
        """Return the fits of the candidates that `chosen` selects (indices or a slice)."""
        return Fit(self.error[chosen], self.alike[chosen], self.normals[chosen], self.rotated_points[chosen],
                   self.places[chosen])

    def thinned(self, count: int) -> 'Fit':
        """Return the fits of at most `count` points: those that `OrientedPoints.thinned` selects."""
        step = spacing(self.error.shape[1], count)
        return self if step <= 1 else Fit(*(part[:, ::step].copy() for part in self))


def jacobian(normals: ComplexArray, rotated_points: ComplexArray, rows: int = DOF) -> FloatArray:
    """Return ``(..., rows, P)``: the first 3 rows are the derivatives of the errors with respect to x, y and theta.

    Parameters
    ----------
    normals, rotated_points : (..., P) complex arrays
        Conjugated normals of the lines, and rotated points [m].
    rows : int
        Number of rows of the returned array; rows after the third are not filled.
    """
    table = np.empty((*normals.shape[:-1], rows, normals.shape[-1]))
    table[..., 0, :] = normals.real
    np.negative(normals.imag, out=table[..., 1, :])
    np.negative((normals * rotated_points).imag, out=table[..., 2, :])
    return table


def linear_residuals(error: FloatArray, normals: ComplexArray, rotated_points: ComplexArray) -> FloatArray:
    """Return ``(..., 4, P)``: `jacobian` and errors [m]; ``(x, y, theta, 1) @ rows`` are the errors after a step."""
    rows = jacobian(normals, rotated_points, DOF + 1)
    rows[..., DOF, :] = error
    return rows


def normal_equations(rows: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the weighted squares ``(..., 4, 4)`` of `linear_residuals`.

    The upper left 3 x 3 block is the information for points with unit standard deviation, the last column is the
    gradient, and the bottom-right element is the sum of the squared errors. If `rows` is a `jacobian` alone, the result
    is the information alone.
    """
    equations: FloatArray = (rows * weight[..., None, :]) @ rows.swapaxes(-1, -2)
    return equations


class Alignment(NamedTuple):
    """Points, likelihood field and settings with which candidates are refined.

    Attributes
    ----------
    points : OrientedPoints
        Points of the current scan.
    field : LikelihoodField
        Likelihood field of the reference.
    min_normal_cosine : float
        Minimum cosine of the angle between corresponding normals.
    damping : float
        Damping of a step, as in `solve_step`; it keeps candidates from moving in an unobservable direction.
    """

    points: OrientedPoints
    field: LikelihoodField
    min_normal_cosine: float
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


PRIOR_INFORMATION = np.array((0.01, 0.01, 0.1))
"""Information about an unknown motion [1/m^2, 1/m^2, 1/rad^2]: standard deviations of 10 m and of pi [rad]."""
CORRIDOR_RATIO = 0.1
"""A corridor has less than this ratio of the information along its axis to the information in both directions."""
