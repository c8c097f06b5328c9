# SPDX-License-Identifier: Apache-2.0
"""Symmetric positive definite 3 x 3 matrices in plain Python numbers, faster than calls of numpy at this size."""
from collections.abc import Iterable
from typing import TypeAlias

import numpy as np

from .array_types import FloatArray
from .se2 import DOF

Triple: TypeAlias = tuple[float, float, float]

IDENTITY = np.eye(DOF)
IDENTITY.flags.writeable = False


def inverse(matrix: FloatArray) -> FloatArray:
    """Invert a ``(3, 3)`` matrix.

    Raises
    ------
    ZeroDivisionError
        When the matrix is singular.
    """
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = matrix.tolist()
    (a, b, c), (p, q, r) = _factors((xx, xy, xt), (yy, yt), tt)
    tt = 1.0 / c
    yt = -r * tt
    yy = 1.0 / b - r * yt
    xt = -p * yt - q * tt
    xy = -p * yy - q * yt
    xx = 1.0 / a - p * xy - q * xt
    return np.array(((xx, xy, xt), (xy, yy, yt), (xt, yt, tt)))


def mahalanobis(error: Iterable[float], covariance: FloatArray) -> float:
    """Return the squared Mahalanobis distance from zero of an `error` ``(3,)`` with a `covariance` ``(3, 3)``."""
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = covariance.tolist()
    (a, b, c), (p, q, r) = _factors((xx, xy, xt), (yy, yt), tt)
    x, y, t = error
    y -= p * x
    t -= q * x + r * y
    squared: float = x * x / a + y * y / b + t * t / c
    return squared


def determinant(matrix: FloatArray) -> float:
    """Return the determinant of a ``(3, 3)`` matrix."""
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = matrix.tolist()
    (a, b, c), _ = _factors((xx, xy, xt), (yy, yt), tt)
    product: float = a * b * c
    return product


def diagonal(x: float, y: float, t: float) -> FloatArray:
    """Return the ``(3, 3)`` matrix with these numbers on its diagonal; a third of the time of ``np.diag``."""
    return np.array(((x, 0.0, 0.0), (0.0, y, 0.0), (0.0, 0.0, t)))


def solve(equations: FloatArray, damping: float) -> FloatArray:
    """Solve normal equations ``(H, 4, 4)`` for damped steps ``(H, 3)``.

    In each system, the upper left 3 x 3 block is the left-hand side and the last column is the right-hand side. The
    damping is relative to the trace of the translational part.
    """
    rows = equations.reshape(len(equations), equations.shape[-1] ** 2).tolist()
    return np.array([_step(each, damping) for each in rows]).reshape(-1, DOF)


def _step(equations: list[float], damping: float) -> Triple:
    """Solve one system of normal equations for its damped step; `equations` is its (4, 4) array, listed by rows."""
    xx, xy, xt, x, _, yy, yt, y, _, _, tt, t, *_ = equations
    added = damping * (xx + yy + 1e-6)
    (a, b, c), (p, q, r) = _factors((xx + added, xy, xt), (yy + added, yt), tt + added)
    y -= p * x
    t = (t - q * x - r * y) / c
    y = y / b - r * t
    return x / a - p * y - q * t, y, t


def _factors(x_row: Triple, y_row: tuple[float, float], tt: float) -> tuple[Triple, Triple]:
    """Factorise the matrix with this upper triangle as ``L D L'``: return diag(D), and L below its diagonal by rows."""
    xx, xy, xt = x_row
    yy, yt = y_row
    p, q = xy / xx, xt / xx
    b, rest = yy - p * xy, yt - p * xt
    r = rest / b
    return (xx, b, tt - q * xt - r * rest), (p, q, r)
