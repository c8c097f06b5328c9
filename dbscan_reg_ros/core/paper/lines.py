# SPDX-License-Identifier: Apache-2.0
"""Line segments of a scan: breakpoints (Eq. 5), corners (Eq. 6) and lines (Eq. 7) of section 2.2."""
from typing import NamedTuple

import numpy as np

from ..features.records import EndKind, Segments
from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.se2 import as_vectors, unit_complex, wrap
from ..geometry.ties import first_largest, order_up_to_rounding
from ..geometry.tolerance import SAME, TINY

_BREAK_FACTOR = 8.0
"""Open: k of Eq. 5."""
_MAX_THRESHOLDS = 64
"""Open: how many thresholds of the slope difference are tried."""
_CORNER_PENALTY = 200.0
"""Open: what a further segment must save, in squared errors in units of the noise.

Without it the least mean error cuts the lines to pieces, which the paper's figures do not show.
"""
_SECTIONS = 5
"""Sections of a segment whose means the line is fitted to (Eq. 7). Open: their weights W, here all 1."""
_MIN_POINTS, _MIN_LENGTH, _MAX_BEND, _MAX_SEGMENTS = 3, 0.3, 0.15, 100
"""Open: what a segment is: points, length [m], root mean square error per length; the longest ones are kept."""
_MIN_CORNER_SINE, _MAX_CORNER_POINTS = 0.3, 3
"""Open: neighbouring segments meet in a corner from this sine of their angle, and at most this many points apart."""


def find_breaks(points: ComplexArray, beams: IntArray, increment: float) -> BoolArray:
    """Find where a point ``(P,)`` [m] and the next lie too far apart for one surface (Eq. 5), ``(P - 1,)``.

    Open: a beam without a return ends a surface as well.
    """
    radius = np.abs(points)
    threshold = _BREAK_FACTOR * abs(increment) * np.minimum(radius[1:], radius[:-1])
    breaks: BoolArray = (np.abs(np.diff(points)) >= threshold) | (np.diff(beams) > 1)
    return breaks


def extract_segments(points: ComplexArray, beams: IntArray, breaks: BoolArray, noise: FloatArray) -> Segments:
    """Cut the surfaces of a scan at their corners, and fit a line to each piece.

    Parameters
    ----------
    points : (P,) complex
        Positions in beam order [m].
    beams : (P,) int
    breaks : (P - 1,) bool
        Result of `find_breaks`.
    noise : (P,) float
        Standard deviation of each range [m].

    Returns
    -------
    Segments
        In beam order. The paper has no uncertainty of a line: the standard deviations are ``nan``.
    """
    first, last = cut_at_corners(points, breaks, noise)
    fitted = fit_sections(Moments.of(points), first, last)
    along = unit_complex(fitted.angle)
    along[((points[last] - points[first]) * along.conj()).real < 0.0] *= -1.0
    start, end = (fitted.centre + along * ((points[at] - fitted.centre) * along.conj()).real for at in (first, last))
    length = np.abs(end - start)
    kept = np.flatnonzero((last - first + 1 >= _MIN_POINTS) & (length >= _MIN_LENGTH)
                          & (fitted.residual < (_MAX_BEND * length) ** 2))
    kept = np.sort(kept[order_up_to_rounding(-length[kept])[:_MAX_SEGMENTS]])
    first, last = first[kept], last[kept]
    along, start, end = along[kept], start[kept], end[kept]
    kinds = np.full((len(kept), 2), int(EndKind.OCCLUSION))
    for k, meeting in enumerate(_crossings(start, end, along, np.abs(points[first[1:]] - points[last[:-1]]))):
        near = first[k + 1] - last[k] <= _MAX_CORNER_POINTS and not breaks[last[k]:first[k + 1]].any()
        if near and not np.isnan(meeting):
            kinds[k, 1] = kinds[k + 1, 0] = EndKind.CORNER
            end[k] = start[k + 1] = meeting
    unknown = np.full(len(kept), np.nan)
    return Segments(start=as_vectors(start), end=as_vectors(end), direction=np.angle(along), length=np.abs(end - start),
                    sigma_direction=unknown, sigma_offset=unknown, kinds=kinds,
                    beams=np.column_stack((beams[first], beams[last])))


def _crossings(start: ComplexArray, end: ComplexArray, along: ComplexArray, gap: FloatArray) -> ComplexArray:
    """Return where the lines of a segment and the next cross ``(S - 1,)`` [m]; ``nan`` if not near both ends."""
    sine = (along[:-1].conj() * along[1:]).imag
    crossing = np.abs(sine) >= _MIN_CORNER_SINE
    beyond = ((start[1:] - end[:-1]).conj() * along[1:]).imag / np.where(crossing, sine, 1.0)
    meeting = end[:-1] + beyond * along[:-1]
    reach, half = SAME + gap, 0.5 * np.abs(end - start)
    near = crossing & (np.abs(beyond) < reach) & (beyond > -half[:-1])
    near &= np.abs(start[1:] - meeting) < np.minimum(reach, half[1:])
    return np.where(near, meeting, np.nan)


def cut_at_corners(points: ComplexArray, breaks: BoolArray, noise: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the first and the last point of each piece ``(S,)``; a corner belongs to both of its pieces.

    The corners are the points whose slope difference exceeds ``dk_th``. The threshold is searched: the value of each
    local maximum is tried, and the one with the least fitting error is taken, of equal ones that with the fewest
    corners.
    """
    size = len(points)
    starts, ends = np.concatenate(([True], breaks)), np.concatenate((breaks, [True]))
    rank = rank_corners(slope_differences(points, breaks))
    most = int(np.count_nonzero(rank < size))
    corners = np.unique(np.linspace(0, most, min(most + 1, _MAX_THRESHOLDS)).astype(int))
    cut = rank < corners[:, None]
    row, first = np.nonzero(cut | starts)
    last = np.nonzero(cut | ends)[1]
    error = fit_sections(Moments.of(points), first, last).residual * (last - first + 1)
    mean_noise = 0.5 * (noise[first] + noise[last])
    cost = np.bincount(row, error / mean_noise ** 2) + _CORNER_PENALTY * np.bincount(row)
    best = row == first_largest(-cost)
    return first[best], last[best]


def slope_differences(points: ComplexArray, breaks: BoolArray) -> FloatArray:
    """Return the slope difference ``dk`` at each point (Eq. 6), 0 beside a break.

    The filter moves points, so the angle between two neighbours is that of their positions, at least a tenth of the
    median angle.
    """
    difference = np.zeros(len(points))
    if len(points) <= 1:
        return difference
    radius, step = np.abs(points), wrap(np.diff(np.angle(points)))
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
    rank[maxima[order_up_to_rounding(-difference[maxima])]] = np.arange(len(maxima))
    return rank


class Moments(NamedTuple):
    """Sums over the points before each point, ``(P + 1,)``: of p and |p|^2, and of p^2, as complex numbers."""

    first: ComplexArray
    square: FloatArray
    double: ComplexArray

    @classmethod
    def of(cls, points: ComplexArray) -> 'Moments':
        """Return the moments of points ``(P,)`` [m]."""
        return cls(*(np.concatenate(([0.0], np.cumsum(each)))
                     for each in (points, points.real ** 2 + points.imag ** 2, points * points)))


class Fitted(NamedTuple):
    """Lines through ranges of points: a point [m], the direction modulo pi [rad], the mean squared distance [m^2]."""

    centre: ComplexArray
    angle: FloatArray
    residual: FloatArray


def fit_sections(moments: Moments, first: IntArray, last: IntArray) -> Fitted:
    """Fit lines to the means of five equal sections of each range of points (Eq. 7).

    The least squares are perpendicular: with z the offsets from their mean, the direction is half the angle of the sum
    of z^2. In a range of fewer points than sections, each point is a section. `residual` is that of all points.
    """
    count = last - first + 1
    edges = first[:, None] + count[:, None] * np.arange(_SECTIONS + 1) // _SECTIONS
    size = np.diff(edges, axis=1)
    filled = size > 0
    means = np.diff(moments.first[edges], axis=1) / np.maximum(size, 1)
    centre = means.sum(axis=1) / filled.sum(axis=1)
    offset = np.where(filled, means - centre[:, None], 0.0)
    angle = 0.5 * np.angle((offset * offset).sum(axis=1))
    # All points, from the centre: the mean of |z|^2 and of z^2 gives that of the squared distances from the line.
    mean, square, double = ((each[last + 1] - each[first]) / count for each in moments)
    about = square - 2.0 * (mean * centre.conj()).real + np.abs(centre) ** 2
    turned = (double - 2.0 * mean * centre + centre * centre) * unit_complex(-2.0 * angle)
    return Fitted(centre, angle, np.maximum(0.5 * (about - turned.real), 0.0))
