# SPDX-License-Identifier: Apache-2.0
"""Corners where the slope of the ranges jumps, above a threshold that is searched by fitting error (Eq. 6-7)."""
import numpy as np

from ..geometry.line_fit import fit_sections
from ..geometry.se2 import wrap
from ..parameters.features import SegmentParameters


def slope_stretches(points, total, radius, breaks, noise, parameters: SegmentParameters):
    """Cut the runs of a scan at the corners of the best threshold ``dk_th``.

    Every local maximum of the slope difference (Eq. 6) is a corner or none, so only so many thresholds differ; each
    of them, or `corner_thresholds` of them evenly by rank, is tried. Without a penalty the least mean squared error of
    all segments wins, as the paper says: nearly always the most corners. With one the sum of the squared errors, in
    units of the noise, plus the penalty for every segment decides; of equals the fewest corners.

    Parameters
    ----------
    points, radius, breaks
        As for `find_breaks`.
    total : (5, P + 1) array
        `summed_moments` of the points.
    noise : (P,) array
        Standard deviation of each range [m].
    parameters : SegmentParameters

    Returns
    -------
    first, last : (S,) int arrays
        First and last point of each stretch; a corner belongs to both of its stretches.
    """
    starts, ends = np.ones(len(points), dtype=bool), np.ones(len(points), dtype=bool)
    starts[1:], ends[:-1] = breaks, breaks
    rank = rank_corners(slope_differences(points, radius, breaks))
    most = np.count_nonzero(rank < len(points))
    corners = np.unique(np.linspace(0, most, min(most + 1, parameters.corner_thresholds)).astype(int))
    cut = rank < corners[:, None]
    row, first = np.nonzero(cut | starts)
    last = np.nonzero(cut | ends)[1]
    _, _, _, residual = fit_sections(total, first, last, parameters.sections)
    error = residual * (last - first + 1)
    segments = np.bincount(row)
    if parameters.corner_penalty > 0.0:
        usual = 0.5 * (noise[first] + noise[last])
        cost = np.bincount(row, error / usual ** 2) + parameters.corner_penalty * segments
    else:
        cost = np.bincount(row, error) / segments
    best = row == np.argmin(cost)
    return first[best], last[best]


def slope_differences(points, radius, breaks):
    """``(P,)`` slope difference ``dk`` at each point (Eq. 6); 0 where the point before or after is on another surface.

    The angle between neighbours is that of the points themselves, which need not be evenly apart; where two hardly
    differ in bearing a tenth of the usual step is taken.
    """
    difference = np.zeros(len(points))
    if len(points) < 3:
        return difference
    step = wrap(np.diff(np.angle(points)))
    least = max(0.1 * float(np.median(np.abs(step))), 1e-6)
    step = np.where(np.abs(step) < least, np.copysign(least, step), step)
    slope = np.diff(radius) / (radius[:-1] * step)
    difference[1:-1] = np.where(breaks[1:] | breaks[:-1], 0.0, np.abs(np.diff(slope)))
    return difference


def rank_corners(difference):
    """``(P,)`` rank of each local maximum of the slope difference, 0 for the greatest; P for all other points."""
    rank = np.full(len(difference), len(difference))
    middle = difference[1:-1]
    maxima = np.flatnonzero((middle > difference[:-2]) & (middle > difference[2:])) + 1
    rank[maxima[np.argsort(-difference[maxima], kind='stable')]] = np.arange(len(maxima))
    return rank
