# SPDX-License-Identifier: Apache-2.0
"""Point-to-line correspondences, normal equations and robust iterations."""
import math
from typing import NamedTuple

import numpy as np

from ..features.oriented_points import stride
from ..geometry.robust_kernel import kernel
from ..geometry.symmetric_matrix import solve, solve_one


def origins(candidates):
    """``(H, 1)`` complex: where each candidate puts the sensor [m]."""
    return candidates[:, :2].copy().view(complex)


def transform_points(candidates, points):
    """``(H, P)`` complex points moved by every candidate (Eq. 8)."""
    return np.exp(1j * candidates[:, 2:]) * points + origins(candidates)


class Fit(NamedTuple):
    """A scan's points beside a surface's lines, under every candidate.

    Attributes
    ----------
    error : (H, P) float [m]
        Signed distance from the line of the nearest point, times the cloud's `inverse_noise`.
    alike : (H, P) bool
        Whether that point faces the same way.
    normals : (H, P) complex
        Its normal, conjugated, times the same.
    arms : (H, P) complex [m]
        Turned points.
    places : (H, P) complex [m]
        Turned and moved points.
    """

    error: np.ndarray
    alike: np.ndarray
    normals: np.ndarray
    rotated_points: np.ndarray
    places: np.ndarray

    def weight(self, scale):
        """``(H, P)`` Gaussian kernel of the `scale` [m] of the distances (Eq. 18), 0 without a partner that faces the same way."""
        weight = kernel(self.error, scale)
        weight *= self.alike
        return weight

    def rows(self):
        """``(H, 4, P)`` `linear_residuals`."""
        return linear_residuals(self.error, self.normals, self.rotated_points)

    def select(self, chosen):
        """The fits of the candidates that `chosen`, indices or a slice, picks."""
        return Fit(*(part[chosen] for part in self))

    def thinned(self, count):
        """That of at most `count` of the points, as `OrientedPoints.thinned`."""
        step = stride(self.error.shape[1], count)
        return self if step <= 1 else Fit(*(part[:, ::step].copy() for part in self))


def fit(candidates, cloud, surface, facing) -> Fit:
    """The `Fit` of a scan's points to a surface.

    Parameters
    ----------
    candidates : (H, 3) array
    cloud : Cloud
    surface : Surface
    facing : float
        Least cosine of the angle between the normals of partners.
    """
    turn = np.exp(1j * candidates[:, 2:])
    rotated_points = turn * cloud.points
    places = rotated_points + origins(candidates)
    nearest = surface.nearest(places)
    normals = surface.normals.take(nearest)
    error = cloud.sharpened((normals * places).real - surface.offsets.take(nearest))
    alike = (normals * (turn * cloud.normals)).real > facing
    if facing < 0.0:
        # The normal of no point is 0.
        alike &= nearest != len(surface.normals) - 1
    return Fit(error, alike, cloud.sharpened(normals), rotated_points, places)


def jacobian(normals, rotated_points, rows=3):
    """``(..., rows, P)``: of the points' errors by x, y [m] and theta [rad] in the first three rows.

    Parameters
    ----------
    normals, arms : (..., P) complex arrays
        Conjugated normals of the lines, and turned points [m].
    """
    table = np.empty((*normals.shape[:-1], rows, normals.shape[-1]))
    table[..., 0, :] = normals.real
    np.negative(normals.imag, out=table[..., 1, :])
    np.negative((normals * rotated_points).imag, out=table[..., 2, :])
    return table


def linear_residuals(error, normals, rotated_points):
    """``(..., 4, P)``: the `jacobian`, and the errors [m] themselves; times a step ``(x, y, theta, 1)`` the errors after it."""
    rows = jacobian(normals, rotated_points, 4)
    rows[..., 3, :] = error
    return rows


NO_STEP = np.array((0.0, 0.0, 0.0, 1.0))


def normal_equations(rows, weight):
    """``(..., 4, 4)`` weighted squares of `linear_residuals`.

    The upper left 3 x 3 are the information for a unit error of a point, the last column the gradient, the last number
    the sum of the squared errors. Of the `jacobian` alone: the information.
    """
    return (rows * weight[..., None, :]) @ rows.swapaxes(-1, -2)


def shared_information(rows, weight, own):
    """``(3, 3)`` information of points for a unit error of each, as far as both scans agree on it.

    One factor of each product is the partner's normal and one the point's own: what noise makes of either cancels, so
    that a smooth wall does not seem to hold the motion along it. It may be indefinite where there is nothing but noise.

    Parameters
    ----------
    rows, own : (3, P) arrays
        `jacobian` by the normals of the partners, and by the points' own.
    weight : (P,) array
    """
    product = (rows * weight) @ own.T
    return 0.5 * (product + product.T)


def mean_square(error, weight):
    """Weighted mean [m^2] of squared errors."""
    return float(error * weight @ error) / max(float(weight.sum()), 1e-9)


def refine(candidates, cloud, surface, scales, facing, damping, known=None):
    """Robust point-to-line iterations of all candidates together, one for each of the `scales` [m].

    A little damping keeps a direction that the points do not determine where it is.

    Parameters
    ----------
    known : Fit, optional
        Of the candidates as they are.

    Returns
    -------
    candidates : (H, 3) array
    equations : (H, 4, 4) array
        The `normal_equations` of the last iteration.
    """
    candidates, equations = candidates.copy(), np.zeros((len(candidates), 4, 4))
    for scale in scales:
        now, known = known or fit(candidates, cloud, surface, facing), None
        equations = normal_equations(now.rows(), cloud.weighted(now.weight(scale)))
        candidates -= solve(equations, damping)
    return candidates, equations


def next_step(found, cloud, scale, damping):
    """The step ``(3,)`` of one more iteration with a kernel of the `scale` [m], from the one candidate whose `Fit` was `found`."""
    return -solve_one(normal_equations(found.rows()[0], cloud.weighted(found.weight(scale))[0]), damping)


def polish(candidate, found, cloud, refinement):
    """Last iterations of one candidate ``(3,)``, with a kernel that narrows to the spread of the errors.

    The partners stay those of `found`, the candidate's `Fit`: the errors are linear in the step. A candidate that creeps
    farther than the first kernel reaches, as along a corridor, stays where it was.

    Returns
    -------
    candidate : (3,) array
    found : Fit
        Of it, H = 1.
    """
    if not refinement.polish_iterations:
        return candidate, found
    rows, weights = found.rows()[0], cloud.weighted(found.alike[0].astype(float))
    way, scale = np.zeros(3), refinement.final_scale
    for _ in range(refinement.polish_iterations):
        weight = kernel(rows[3], scale) * weights
        equations = normal_equations(rows, weight)
        step = solve_one(equations, refinement.damping)
        scale = refinement.narrowed(scale, math.sqrt(equations.item(15) / max(float(weight.sum()), 1e-9)))
        way += step
        rows[3] -= step @ rows[:3]
    if math.hypot(way[0], way[1]) >= refinement.final_scale:
        return candidate, found
    return candidate - way, found._replace(error=rows[3:])
