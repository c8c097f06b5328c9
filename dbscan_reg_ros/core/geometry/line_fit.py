# SPDX-License-Identifier: Apache-2.0
"""Lines through many groups of points at once, by total least squares (Eq. 7)."""
from typing import NamedTuple

import numpy as np

from .array_types import ComplexArray, FloatArray, IntArray


class Lines(NamedTuple):
    """Lines through S groups of points.

    Attributes
    ----------
    centre : (2, S) float [m]
        A point on each line.
    angle : (S,) float [rad]
        Direction, modulo pi.
    spread, residual : (S,) float [m^2]
        Mean squared distance of the points from `centre` along the line, and perpendicular to the line.
    """

    centre: FloatArray
    angle: FloatArray
    spread: FloatArray
    residual: FloatArray


def point_moments(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return x, y, xx, xy, yy of each point [m, m^2] as an array ``(5, ...)``."""
    return np.array((x, y, x * x, x * y, y * y))


def summed_moments(points: ComplexArray) -> FloatArray:
    """Sum the moments of points ``(P,)`` cumulatively.

    Returns
    -------
    (5, P + 1) float
        Sums of the `point_moments` before each point: the difference of two columns is the sum over a range of points.
    """
    moments = point_moments(points.real, points.imag)
    total = np.zeros((len(moments), len(points) + 1))
    moments.cumsum(axis=1, out=total[:, 1:])
    return total


def fit_lines(moments: FloatArray, count: FloatArray | IntArray) -> Lines:
    """Fit total least squares lines to groups of points (Eq. 7, perpendicular distances).

    Parameters
    ----------
    moments : (5, S) float
        Sums of the `point_moments` of each group.
    count : (S,) int
        Number of points in each group.
    """
    mean = moments / count
    xx, xy, yy = _covariance(mean)
    half, apart = 0.5 * (xx + yy), 0.5 * (xx - yy)
    root = np.hypot(apart, xy)
    return Lines(mean[:2], 0.5 * np.arctan2(xy, apart), half + root, np.maximum(half - root, 0.0))


def _covariance(mean: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return xx, xy, yy of the covariance [m^2] from the mean moments ``(5, S)``."""
    mx, my, xx, xy, yy = mean
    return xx - mx * mx, xy - mx * my, yy - my * my
