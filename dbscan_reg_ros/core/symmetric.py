"""Symmetric 3 x 3 matrices in plain numbers: for so small ones an array library costs more than they do."""
import numpy as np


def inverse(matrix):
    """Inverse of a symmetric ``(3, 3)`` matrix.

    Raises
    ------
    ZeroDivisionError
        When it is singular.
    """
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = matrix.tolist()
    a, b, c, d, e, f = _inverse(xx, xy, xt, yy, yt, tt)
    return np.array(((a, b, c), (b, d, e), (c, e, f)))


def mahalanobis(off, covariance):
    """Squared Mahalanobis distance of an error ``(3,)`` from 0."""
    return float(off @ inverse(covariance) @ off)


def solve(equations, damping):
    """Damped steps ``(H, 3)`` of normal equations ``(H, 4, 4)``; the damping is relative to each one's own trace.

    The left side is the upper left 3 x 3 of each, the right side the last column.
    """
    steps = []
    for xx, xy, xt, x, _, yy, yt, y, _, _, tt, t, *_ in equations.reshape(-1, 16).tolist():
        lift = damping * (xx + yy + 1e-6)
        a, b, c, d, e, f = _inverse(xx + lift, xy, xt, yy + lift, yt, tt + lift)
        steps.append((a * x + b * y + c * t, b * x + d * y + e * t, c * x + e * y + f * t))
    return np.array(steps)


def _inverse(xx, xy, xt, yy, yt, tt):
    """The upper right triangle of the inverse, row by row, from that of the matrix: by cofactors."""
    a, b, c = yy * tt - yt * yt, xt * yt - xy * tt, xy * yt - xt * yy
    scale = 1.0 / (xx * a + xy * b + xt * c)
    return (a * scale, b * scale, c * scale,
            (xx * tt - xt * xt) * scale, (xy * xt - xx * yt) * scale, (xx * yy - xy * xy) * scale)
