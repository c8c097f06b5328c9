"""Kernels over many candidate motions at once: how well a scan fits a surface, and how to move it closer.

Pure functions, arrays in and arrays out. Candidates are rows ``(x, y, theta)`` of an ``(H, 3)`` array; every kernel
costs a fixed number of array operations, whatever the number of candidates.
"""
import numpy as np


def transform_points(candidates, x, y):
    """Points moved by every candidate: ``(H, P)`` arrays px, py and, relative to the candidate's origin, rx, ry."""
    c, s = np.cos(candidates[:, 2:]), np.sin(candidates[:, 2:])
    rx = c * x
    rx -= s * y
    ry = s * x
    ry += c * y
    return rx + candidates[:, :1], ry + candidates[:, 1:2], rx, ry


def free_space_violation(radius, near, tolerance):
    """1 for a point well in front of what the other scan saw there, fading to 0 within the tolerance."""
    front = near - radius
    front -= tolerance
    front *= 1.0 / tolerance
    return np.clip(front, 0.0, 1.0, out=front)


def residuals(candidates, cloud, surface, scale, parameters):
    """Distances of a scan's points from the surface's lines under every candidate.

    Returns
    -------
    error : (H, P) array [m]
        Signed distance from the line of the nearest point.
    weight : (H, P) array
        Gaussian kernel of the distance (Eq. 18), 0 without a partner that faces the same way.
    jx, jy, jt : (H, P) arrays
        Derivative of the error with respect to x, y [m] and theta [rad].
    """
    px, py, rx, ry = transform_points(candidates, cloud.x, cloud.y)
    nearest = surface.nearest(px, py)
    nx, ny = surface.nx.take(nearest), surface.ny.take(nearest)
    px -= surface.x.take(nearest)
    py -= surface.y.take(nearest)
    error = nx * px
    error += ny * py
    px *= ny
    py *= nx
    py -= px
    c, s = np.cos(candidates[:, 2:]), np.sin(candidates[:, 2:])
    facing = nx * (c * cloud.nx - s * cloud.ny)
    facing += ny * (s * cloud.nx + c * cloud.ny)
    weight = error * error
    weight *= -0.5 / (scale * scale)
    np.exp(weight, out=weight)
    weight *= facing > parameters.facing
    weight *= np.abs(py) < parameters.reach
    jt = ny * rx
    jt -= nx * ry
    return error, weight, nx, ny, jt


def normal_equations(error, weight, jx, jy, jt):
    """``(H, 3, 3)`` information matrices and ``(H, 3)`` gradients of the weighted squared errors."""
    jacobian = np.stack((jx, jy, jt), axis=1)
    weighted = jacobian * weight[:, None]
    information = weighted @ jacobian.transpose(0, 2, 1)
    gradient = (weighted @ error[:, :, None])[:, :, 0]
    return information, gradient


def information(candidates, cloud, surface, scale, parameters):
    """``(H, 3, 3)`` information matrix of each candidate, for a unit error of a point."""
    return normal_equations(*residuals(candidates, cloud, surface, scale, parameters))[0]


def refine(candidates, cloud, surface, scales, parameters, damping):
    """Robust point-to-line iterations of all candidates together, one for each of the `scales` [m].

    A little damping keeps a direction that the points do not determine where it is.

    Returns
    -------
    (H, 3) array
    """
    candidates = candidates.copy()
    for scale in scales:
        candidates -= solve(*normal_equations(*residuals(candidates, cloud, surface, scale, parameters)), damping)
    return candidates


def polish(candidate, cloud, surface, density, refinement):
    """Last iterations of one candidate ``(3,)``, with a kernel that narrows to the spread of the errors.

    A candidate that creeps farther than the first kernel reaches, as along a corridor, stays where it was.
    """
    first, candidate, scale = candidate, candidate[None].copy(), refinement.final_scale
    for _ in range(refinement.polish):
        error, weight, jx, jy, jt = residuals(candidate, cloud, surface, scale, density)
        step = solve(*normal_equations(error, weight, jx, jy, jt), refinement.damping)
        candidate -= step
        narrower = refinement.narrowed(scale, mean_square(error, weight) ** 0.5)
        if np.abs(step).max() < _CONVERGED and narrower > 0.98 * scale:
            break
        scale = narrower
    crept = np.hypot(*(candidate[0, :2] - first[:2]))
    return candidate[0] if crept < refinement.final_scale else first


_CONVERGED = 1e-5


def mean_square(error, weight):
    """Weighted mean of the squared errors [m^2]."""
    error, weight = error.ravel(), weight.ravel()
    return float(weight @ (error * error)) / max(float(weight.sum()), 1e-9)


def solve(information, gradient, damping):
    """Damped steps ``(H, 3)``; the damping is relative to each matrix's own trace."""
    diagonal = np.einsum('hii->hi', information)
    diagonal += damping * (diagonal[:, :2].sum(axis=1, keepdims=True) + 1e-6)
    return np.linalg.solve(information, gradient[:, :, None])[:, :, 0]
