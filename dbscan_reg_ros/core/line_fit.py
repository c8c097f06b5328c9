"""Lines through many stretches of points at once, by total least squares (Eq. 7)."""
import numpy as np


def point_moments(points):
    """``(P, 5)``: x, y, xx, xy, yy of each point."""
    x, y = points[:, 0], points[:, 1]
    return np.array((x, y, x * x, x * y, y * y)).T


def summed_moments(points):
    """``(P + 1, 5)``: sums of the moments of all points before each; stretches are differences of its rows."""
    total = np.zeros((len(points) + 1, 5))
    point_moments(points).cumsum(axis=0, out=total[1:])
    return total


def fit_lines(moments, count):
    """Total least squares lines through groups of points (Eq. 7, perpendicular distances).

    Parameters
    ----------
    moments : (S, 5) array
        Sums of x, y, xx, xy, yy over each group.
    count : (S,) array
        Number of points in each.

    Returns
    -------
    centre : (S, 2) array [m]
    angle : (S,) array [rad], modulo pi
    spread, residual : (S,) arrays [m^2]
        Mean squared extent along and distance from the line.
    """
    mean = moments / count[:, None]
    xx, xy, yy = _covariance(mean)
    angle = 0.5 * np.arctan2(2.0 * xy, xx - yy)
    half, root = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    return mean[:, :2], angle, half + root, np.maximum(half - root, 0.0)


def fit_sections(total, first, last, sections):
    """Lines through the means of equal sections of each stretch of points (Eq. 7; the paper takes five).

    A stretch of fewer points than sections is fitted to its points: each is a section of its own. Every section has
    the weight 1 (W of Eq. 7).

    Parameters
    ----------
    total : (P + 1, 5) array
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
    moments = total[last + 1] - total[first]
    if sections == 0:
        return fit_lines(moments, count)
    edges = first[:, None] + count[:, None] * np.arange(sections + 1) // sections
    size = np.diff(edges, axis=1)
    means = np.diff(total[edges, :2], axis=1) / np.maximum(size, 1)[..., None]
    filled = size > 0
    sums = (point_moments(means.reshape(-1, 2)) * filled.reshape(-1, 1)).reshape(*size.shape, 5).sum(axis=1)
    centre, angle, _, _ = fit_lines(sums, filled.sum(axis=1))
    mean = moments / count[:, None]
    xx, xy, yy = _covariance(mean)
    c, s = np.cos(angle), np.sin(angle)
    off = c * (mean[:, 1] - centre[:, 1]) - s * (mean[:, 0] - centre[:, 0])
    spread = c * c * xx + 2.0 * c * s * xy + s * s * yy
    residual = s * s * xx - 2.0 * c * s * xy + c * c * yy + off * off
    return centre, angle, np.maximum(spread, 0.0), np.maximum(residual, 0.0)


def _covariance(mean):
    mx, my = mean[:, 0], mean[:, 1]
    return mean[:, 2] - mx * mx, mean[:, 3] - mx * my, mean[:, 4] - my * my
