# SPDX-License-Identifier: Apache-2.0
"""Lines through many stretches of points at once, by total least squares (Eq. 7)."""
import numpy as np


def point_moments(x, y):
    """``(5, ...)``: x, y, xx, xy, yy of each point."""
    return np.array((x, y, x * x, x * y, y * y))


def summed_moments(points):
    """``(5, P + 1)``: sums of the moments of all complex points ``(P,)`` before each; stretches are differences of its columns."""
    total = np.zeros((5, len(points) + 1))
    point_moments(points.real, points.imag).cumsum(axis=1, out=total[:, 1:])
    return total


def fit_lines(moments, count):
    """Total least squares lines through groups of points (Eq. 7, perpendicular distances).

    Parameters
    ----------
    moments : (5, S) array
        Sums of x, y, xx, xy, yy over each group.
    count : (S,) array
        Number of points in each.

    Returns
    -------
    centre : (2, S) array [m]
    angle : (S,) array [rad], modulo pi
    spread, residual : (S,) arrays [m^2]
        Mean squared extent along and distance from the line.
    """
    mean = moments / count
    xx, xy, yy = _covariance(mean)
    half, apart = 0.5 * (xx + yy), 0.5 * (xx - yy)
    root = np.hypot(apart, xy)
    return mean[:2], 0.5 * np.arctan2(xy, apart), half + root, np.maximum(half - root, 0.0)


def fit_sections(total, first, last, sections):
    """Lines through the means of equal sections of each stretch of points (Eq. 7; the paper takes five).

    A stretch of fewer points than sections is fitted to its points: each is a section of its own. Every section has
    the weight 1 (W of Eq. 7).

    Parameters
    ----------
    total : (5, P + 1) array
        `summed_moments` of the scan.
    first, last : (S,) int arrays
        First and last point of each stretch, both inclusive.
    sections : int
        0: every point counts by itself.

    Returns
    -------
    centre, angle, spread, residual
        As `fit_lines`; `spread` and `residual` are those of all points.
    """
    count = last - first + 1
    moments = total[:, last + 1] - total[:, first]
    if sections == 0:
        return fit_lines(moments, count)
    edges = first[:, None] + count[:, None] * np.arange(sections + 1) // sections
    size = np.diff(edges, axis=1)
    means = np.diff(total[:2, edges], axis=2) / np.maximum(size, 1)
    filled = size > 0
    centre, angle, _, _ = fit_lines((point_moments(*means) * filled).sum(axis=2), filled.sum(axis=1))
    mean = moments / count
    xx, xy, yy = _covariance(mean)
    c, s = np.cos(angle), np.sin(angle)
    off = c * (mean[1] - centre[1]) - s * (mean[0] - centre[0])
    spread = c * c * xx + 2.0 * c * s * xy + s * s * yy
    residual = s * s * xx - 2.0 * c * s * xy + c * c * yy + off * off
    return centre, angle, np.maximum(spread, 0.0), np.maximum(residual, 0.0)


def _covariance(mean):
    mx, my, xx, xy, yy = mean
    return xx - mx * mx, xy - mx * my, yy - my * my
