# SPDX-License-Identifier: Apache-2.0
"""Corners at jumps in the slope of the ranges, with the threshold of the jump chosen by the fitting error (Eq. 6-7)."""
import numpy as np

from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.line_fit import fit_sections
from ..geometry.se2 import wrap
from ..geometry.tolerance import TINY
from ..parameters.features import SegmentParameters
from .point_sequence import PointSequence


def slope_stretches(sequence: PointSequence, noise: FloatArray,
                    parameters: SegmentParameters) -> tuple[IntArray, IntArray]:
    """Cut the surfaces of a scan at the corners that the best threshold ``dk_th`` gives.

    Only local maxima of the slope difference (Eq. 6) can be corners. The value of each maximum (or of at most
    `corner_thresholds` maxima, evenly spaced by rank) is tried as the threshold. Without a penalty the mean squared
    error of all segments is minimised, as in the paper, which nearly always gives the most corners. With a penalty, the
    sum of the squared errors in units of the noise, plus the penalty for every segment, is minimised. Among thresholds
    of equal cost, the one with the fewest corners is chosen.

    Parameters
    ----------
    sequence : PointSequence
    noise : (P,) float
        Standard deviation of each range [m].
    parameters : SegmentParameters

    Returns
    -------
    first, last : (S,) int
        First and last point of each piece; a corner belongs to both of its pieces.
    """
    size, breaks = len(sequence.points), sequence.breaks
    starts, ends = np.ones(size, dtype=bool), np.ones(size, dtype=bool)
    starts[1:], ends[:-1] = breaks, breaks
    rank = rank_corners(slope_differences(sequence.points, sequence.radius, breaks))
    most = int(np.count_nonzero(rank < size))
    corners = np.unique(np.linspace(0, most, min(most + 1, parameters.corner_thresholds)).astype(int))
    cut = rank < corners[:, None]
    row, first = np.nonzero(cut | starts)
    last = np.nonzero(cut | ends)[1]
    error = fit_sections(sequence.moments, first, last, parameters.sections).residual * (last - first + 1)
    segments = np.bincount(row)
    if parameters.corner_penalty > 0.0:
        mean_noise = 0.5 * (noise[first] + noise[last])
        cost = np.bincount(row, error / mean_noise ** 2) + parameters.corner_penalty * segments
    else:
        cost = np.bincount(row, error) / segments
    best = row == np.argmin(cost)
    return first[best], last[best]


def slope_differences(points: ComplexArray, radius: FloatArray, breaks: BoolArray) -> FloatArray:
    """Return the slope difference ``dk`` at each point (Eq. 6).

    The angle between neighbouring points is computed from their positions, because they need not be evenly spaced. It
    is raised to at least a tenth of the median angle.

    Parameters
    ----------
    points : (P,) complex
        Positions in beam order [m].
    radius : (P,) float
        Range of each point [m].
    breaks : (P - 1,) bool
        True if a point and the next one lie on different surfaces, as in `PointSequence`.

    Returns
    -------
    (P,) float
        0 where the point before or after lies on another surface.
    """
    difference = np.zeros(len(points))
    if len(points) <= 1:
        return difference
    step = wrap(np.diff(np.angle(points)))
    least = max(0.1 * float(np.median(np.abs(step))), TINY)
    step = np.where(np.abs(step) < least, np.copysign(least, step), step)
    slope = np.diff(radius) / (radius[:-1] * step)
    difference[1:-1] = np.where(breaks[1:] | breaks[:-1], 0.0, np.abs(np.diff(slope)))
    return difference


def rank_corners(difference: FloatArray) -> IntArray:
    """Rank the local maxima of the slope difference ``(P,)``: 0 for the largest; P for points that are no maximum."""
    rank = np.full(len(difference), len(difference))
    middle = difference[1:-1]
    maxima = np.flatnonzero((middle > difference[:-2]) & (middle > difference[2:])) + 1
    rank[maxima[np.argsort(-difference[maxima], kind='stable')]] = np.arange(len(maxima))
    return rank
