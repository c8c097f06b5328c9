"""Kernels over many candidate motions at once: how well a scan fits a surface, and how to move it closer.

Pure functions, arrays in and arrays out. Candidates are rows ``(x, y, theta)`` of an ``(H, 3)`` array; every kernel
costs a fixed number of array operations, whatever the number of candidates.
"""
import numpy as np

from .symmetric import solve


def origins(candidates):
    """``(H, 1)`` complex: where each candidate puts the sensor [m]."""
    return candidates[:, :2].copy().view(complex)


def transform_points(candidates, points):
    """``(H, P)`` complex points moved by every candidate (Eq. 8)."""
    return np.exp(1j * candidates[:, 2:]) * points + origins(candidates)


def kernel(error, scale):
    """Gaussian kernel of the `scale` [m] of distances [m] (Eq. 18), 1 at 0."""
    weight = error * error
    weight *= -0.5 / (scale * scale)
    return np.exp(weight, out=weight)


def residuals(candidates, cloud, surface, scale, facing):
    """Distances of a scan's points from the surface's lines under every candidate.

    Parameters
    ----------
    scale : float [m]
        Of the kernel.
    facing : float
        Least cosine of the angle between the normals of partners.

    Returns
    -------
    error : (H, P) array [m]
        Signed distance from the line of the nearest point.
    weight : (H, P) array
        Gaussian kernel of the distance (Eq. 18), 0 without a partner that faces the same way.
    normals : (H, P) complex array
        Normals of the partners, conjugated.
    arms : (H, P) complex array [m]
        Turned points.
    """
    placed = _place(candidates, cloud)
    return _errors(placed, _partners(placed, cloud, surface, facing), scale)


def _place(candidates, cloud):
    """What turns the scan's points, the turned points and their places, under every candidate."""
    turn = np.exp(1j * candidates[:, 2:])
    arms = turn * cloud.points
    return turn, arms, arms + origins(candidates)


def _partners(placed, cloud, surface, facing):
    """Normals and offsets ``(H, P)`` of the nearest points' lines, and whether they face the same way."""
    turn, _, places = placed
    nearest = surface.nearest(places)
    normals = surface.normals.take(nearest)
    return normals, surface.offsets.take(nearest), (normals * (turn * cloud.normals)).real > facing


def _errors(placed, partners, scale):
    """As `residuals`."""
    (_, arms, places), (normals, offsets, alike) = placed, partners
    error = (normals * places).real
    error -= offsets
    weight = kernel(error, scale)
    weight *= alike
    return error, weight, normals, arms


def normal_equations(error, weight, normals, arms):
    """``(H, 4, 4)`` weighted squares of the errors' derivatives by x, y [m] and theta [rad], and of the errors.

    The upper left 3 x 3 are the information for a unit error of a point, the last column the gradient, the last number
    the sum of the squared errors.
    """
    rows = _derivatives(normals, arms, 4)
    rows[:, 3] = error
    return (rows * weight[:, None]) @ rows.transpose(0, 2, 1)


def _derivatives(normals, arms, rows):
    """``(H, rows, P)``: of the points' errors by x, y [m] and theta [rad] in the first three rows."""
    table = np.empty((len(normals), rows, normals.shape[1]))
    table[:, 0] = normals.real
    np.negative(normals.imag, out=table[:, 1])
    np.negative((normals * arms).imag, out=table[:, 2])
    return table


def shared_information(weight, normals, arms, own):
    """``(H, 3, 3)`` information of points for a unit error of each, as far as both scans agree on it.

    One factor of each product is the partner's normal and one the point's `own`: what noise makes of either cancels, so
    that a smooth wall does not seem to hold the motion along it. It may be indefinite where there is nothing but noise.

    Parameters
    ----------
    weight, normals, arms : (H, P) arrays
        As from `residuals`.
    own : (H, P) complex array
        Turned normals of the points, conjugated.
    """
    partners, points = _derivatives(normals, arms, 3), _derivatives(own, arms, 3)
    partners *= weight[:, None]
    product = partners @ points.transpose(0, 2, 1)
    return 0.5 * (product + product.transpose(0, 2, 1))


def refine(candidates, cloud, surface, scales, facing, damping):
    """Robust point-to-line iterations of all candidates together, one for each of the `scales` [m].

    A little damping keeps a direction that the points do not determine where it is.

    Returns
    -------
    candidates : (H, 3) array
    equations : (H, 4, 4) array
        The `normal_equations` of the last iteration.
    """
    candidates, equations = candidates.copy(), np.zeros((len(candidates), 4, 4))
    for scale in scales:
        equations = normal_equations(*residuals(candidates, cloud, surface, scale, facing))
        candidates -= solve(equations, damping)
    return candidates, equations


def polish(candidate, cloud, surface, facing, refinement):
    """Last iterations of one candidate ``(3,)``, with a kernel that narrows to the spread of the errors.

    Partners are looked for once. A candidate that creeps farther than the first kernel reaches, as along a corridor, stays
    where it was.
    """
    first, candidate, scale, partners = candidate, candidate[None].copy(), refinement.final_scale, None
    for _ in range(refinement.polish):
        placed = _place(candidate, cloud)
        partners = partners or _partners(placed, cloud, surface, facing)
        equations = normal_equations(*_errors(placed, partners, scale))
        candidate -= solve(equations, refinement.damping)
        scale = refinement.narrowed(scale, mean_square(equations[0]) ** 0.5)
    crept = np.hypot(*(candidate[0, :2] - first[:2]))
    return candidate[0] if crept < refinement.final_scale else first


def mean_square(equations):
    """Weighted mean of the squared errors [m^2] of normal equations ``(4, 4)``: normals are of unit length."""
    return float(equations[3, 3]) / max(float(equations[0, 0] + equations[1, 1]), 1e-9)
