# SPDX-License-Identifier: Apache-2.0
"""Symmetric positive definite 3 x 3 matrices in plain numbers: for so small ones an array library costs more than they do."""
import numpy as np


def inverse(matrix):
    """Inverse of a ``(3, 3)`` matrix.

    Raises
    ------
    ZeroDivisionError
        When it is singular.
    """
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = matrix.tolist()
    a, b, c, p, q, r = _factors(xx, xy, xt, yy, yt, tt)
    tt = 1.0 / c
    yt = -r * tt
    yy = 1.0 / b - r * yt
    xt = -p * yt - q * tt
    xy = -p * yy - q * yt
    xx = 1.0 / a - p * xy - q * xt
    return np.array(((xx, xy, xt), (xy, yy, yt), (xt, yt, tt)))


def mahalanobis(off, covariance):
    """Squared Mahalanobis distance of an error ``(3,)`` from 0."""
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = covariance.tolist()
    a, b, c, p, q, r = _factors(xx, xy, xt, yy, yt, tt)
    x, y, t = off.tolist()
    y -= p * x
    t -= q * x + r * y
    return x * x / a + y * y / b + t * t / c


def solve(equations, damping):
    """Damped steps ``(H, 3)`` of normal equations ``(H, 4, 4)``.

    The left side is the upper left 3 x 3 of each, the right side the last column. The damping is relative to the trace of the
    translational part.
    """
    return np.array([_step(each, damping) for each in equations.reshape(-1, 16).tolist()]).reshape(-1, 3)


def solve_one(equations, damping):
    """The step ``(3,)`` of one system ``(4, 4)``, as `solve`."""
    return np.array(_step(equations.ravel().tolist(), damping))


def _step(equations, damping):
    xx, xy, xt, x, _, yy, yt, y, _, _, tt, t, *_ = equations
    lift = damping * (xx + yy + 1e-6)
    a, b, c, p, q, r = _factors(xx + lift, xy, xt, yy + lift, yt, tt + lift)
    y -= p * x
    t = (t - q * x - r * y) / c
    y = y / b - r * t
    return x / a - p * y - q * t, y, t


def _factors(xx, xy, xt, yy, yt, tt):
    """``L D L'``: the diagonal of D, and row by row what stands below the ones of L."""
    p, q = xy / xx, xt / xx
    b, rest = yy - p * xy, yt - p * xt
    r = rest / b
    return xx, b, tt - q * xt - r * rest, p, q, r
