# SPDX-License-Identifier: Apache-2.0
"""Line segments of a scan: corners (Eq. 6), line fits (Eq. 7) and the kinds of their ends (section 2.2)."""
from typing import NamedTuple

import numpy as np

from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.line_fit import Lines, fit_lines
from ..geometry.se2 import as_complex, as_vectors, unit_complex
from ..geometry.tolerance import SAME, SIGMAS, TINY, order_up_to_rounding
from ..parameters.features import SegmentParameters
from .point_sequence import PointSequence
from .records import EndKind, Segments


def extract_segments(sequence: PointSequence, noise: FloatArray, parameters: SegmentParameters) -> Segments:
    """Extract the line segments of one scan.

    Parameters
    ----------
    sequence : PointSequence
    noise : (P,) float
        Standard deviation of each range [m].
    parameters : SegmentParameters

    Returns
    -------
    Segments
        The segments in beam order.
    """
    found = _fitted(sequence, noise, parameters)
    found = found.select(_longest(found, parameters))
    sigma = 0.5 * (noise[found.first] + noise[found.last])
    sigma = np.sqrt(sigma * sigma + found.residual)
    kinds = _end_kinds(sequence, found, noise, parameters)
    return Segments(
        start=as_vectors(found.start), end=as_vectors(found.end),
        direction=np.arctan2(found.along.imag, found.along.real), length=np.abs(found.end - found.start),
        sigma_direction=sigma / np.sqrt(np.maximum(found.size * found.spread, TINY)),
        sigma_offset=sigma / np.sqrt(found.size), kinds=kinds,
        beams=np.array((sequence.beams[found.first], sequence.beams[found.last])).T)


class _Fitted(NamedTuple):
    """The S segments with fitted lines.

    Attributes
    ----------
    first, last : (S,) int
        First and last point of each segment.
    size : (S,) int
        Number of points of each segment.
    start, end : (S,) complex [m]
        End points of each segment on its line.
    along : (S,) complex
        Unit direction from start to end.
    spread, residual : (S,) float [m^2]
        Mean squared distances along and from the line, as in `Lines`.
    """

    first: IntArray
    last: IntArray
    size: IntArray
    start: ComplexArray
    end: ComplexArray
    along: ComplexArray
    spread: FloatArray
    residual: FloatArray

    def select(self, chosen: IntArray) -> '_Fitted':
        return _Fitted(first=self.first[chosen], last=self.last[chosen], size=self.size[chosen],
                       start=self.start[chosen], end=self.end[chosen], along=self.along[chosen],
                       spread=self.spread[chosen], residual=self.residual[chosen])


class _Pieces(NamedTuple):
    """The S pieces of the surfaces of a scan: first point, last point, number of points and summed moments (5, S)."""

    first: IntArray
    last: IntArray
    size: IntArray
    moments: FloatArray


def _fitted(sequence: PointSequence, noise: FloatArray, parameters: SegmentParameters) -> _Fitted:
    """Cut the surfaces at corners and fit a line to each piece."""
    points = sequence.points
    (first, last, size, _), lines = _straight_pieces(sequence, noise, parameters)
    x, y = lines.centre
    centre, along = as_complex(np.column_stack((x, y))), unit_complex(lines.angle)
    along[((points[last] - points[first]) * along.conj()).real < 0.0] *= -1.0
    start = centre + along * ((points[first] - centre) * along.conj()).real
    end = centre + along * ((points[last] - centre) * along.conj()).real
    return _Fitted(first=first, last=last, size=size, start=start, end=end, along=along, spread=lines.spread,
                   residual=lines.residual)


def _longest(found: _Fitted, parameters: SegmentParameters) -> IntArray:
    """Return the indices of the `max_segments` longest segments that are long, straight and have enough points."""
    length = np.abs(found.end - found.start)
    keep = (found.size >= parameters.min_points) & (length >= parameters.min_length)
    keep &= found.residual < (_MAX_BEND * length) ** 2
    chosen = keep.nonzero()[0]
    if len(chosen) > parameters.max_segments:
        chosen = np.sort(chosen[order_up_to_rounding(-length[chosen])[:parameters.max_segments]])
    return chosen


def split_surfaces(sequence: PointSequence, noise: FloatArray,
                   parameters: SegmentParameters) -> tuple[IntArray, IntArray]:
    """Split all surfaces at their corners, level by level.

    Within each piece, the point that exceeds its split distance from the chord by the most becomes a corner, the first
    of them if there are several.

    Returns
    -------
    first, last : (S,) int
        First and last point of each piece.
    """
    points = sequence.points
    split_distance = np.maximum(SIGMAS * noise + parameters.split_distance, TINY)
    edges = np.concatenate(([True], sequence.breaks, [True]))
    edge = edges.nonzero()[0]
    for _ in range(parameters.split_levels):
        first, length = edge[:-1], edge[1:] - edge[:-1]
        start = points[first]
        chord = points[edge[1:] - 1] - start
        # Distances from the chord beyond the split distance, times the length of the chord.
        area = np.abs((chord.conj().repeat(length) * (points - start.repeat(length))).imag)
        area -= split_distance * np.abs(chord).repeat(length)
        largest = np.maximum.reduceat(area, first)
        largest[largest <= 0.0] = np.inf
        corners = (area >= (largest - TINY).repeat(length)).nonzero()[0]
        corners = corners[np.diff(edge.searchsorted(corners, 'right'), prepend=0) > 0]
        if not len(corners):
            break
        edges[corners + 1] = True
        edge = edges.nonzero()[0]
    return edge[:-1], edge[1:] - 1


def _straight_pieces(sequence: PointSequence, noise: FloatArray,
                     parameters: SegmentParameters) -> tuple[_Pieces, Lines]:
    """Split surfaces at corners and join neighbouring pieces of one line; return the pieces and their lines."""
    first, last = split_surfaces(sequence, noise, parameters)
    kept = (last - first >= _MIN_STEPS).nonzero()[0]
    first, last = first[kept], last[kept]
    pieces = _Pieces(first, last, last - first + 1, sequence.moments[:, last + 1] - sequence.moments[:, first])
    for _ in range(_JOINS):
        number, (first, last, size, moments) = len(pieces.first), pieces
        lines = fit_lines(np.concatenate((moments, moments[:, 1:] + moments[:, :-1]), axis=1),
                          np.concatenate((size, size[1:] + size[:-1])))
        own, joint = (Lines(*(each[..., part] for each in lines)) for part in (slice(number), slice(number, None)))
        apart = _on_different_lines(sequence.points, pieces, own.angle, joint.residual,
                                    _JoinLimits(noise, parameters.join_noise, parameters.join_gap))
        if apart.all():
            return pieces, own
        head = np.concatenate(([True], apart)).nonzero()[0]
        pieces = _Pieces(first[head], last[np.concatenate((head[1:], [number])) - 1], np.add.reduceat(size, head),
                         np.add.reduceat(moments, head, axis=1))
    return pieces, fit_lines(pieces.moments, pieces.size)


class _JoinLimits(NamedTuple):
    """Noise [m] of each range ``(P,)``, and the parameters `join_noise` and `join_gap`."""

    noise: FloatArray
    noise_factor: float
    gap: float


def _on_different_lines(points: ComplexArray, pieces: _Pieces, angle: FloatArray, residual: FloatArray,
                        limits: _JoinLimits) -> BoolArray:
    """Find neighbouring pieces that are not parts of one line.

    Parameters
    ----------
    points : (P,) complex [m]
    pieces : _Pieces
    angle : (S,) float
        Direction of the line through each piece [rad].
    residual : (S - 1,) float
        Residual of the line through a piece and the next [m^2].
    limits : _JoinLimits

    Returns
    -------
    (S - 1,) bool
        False where a piece and the next are parts of one line.
    """
    first, last, noise = pieces.first, pieces.last, limits.noise
    difference = np.abs((angle[1:] - angle[:-1] + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
    reach = points[last] - points[first]
    length = np.abs(reach)
    shorter = np.minimum(length[1:], length[:-1])
    noise = np.maximum(noise[last[:-1]], noise[first[1:]])
    same = residual < (limits.noise_factor * noise) ** 2
    same &= np.abs(points[first[1:]] - points[last[:-1]]) < limits.gap
    same &= (reach[1:] * reach[:-1].conj()).real > 0.0
    tolerance = _JOIN_ANGLE + _JOIN_ANGLE_NOISE * noise / np.maximum(shorter, TINY)
    same &= difference < np.minimum(_MAX_JOIN_ANGLE, tolerance)
    return ~same


def _end_kinds(sequence: PointSequence, found: _Fitted, noise: FloatArray,
               parameters: SegmentParameters) -> IntArray:
    """Return the `EndKind` of both ends of each segment ``(S, 2)``; move ends at corners to the corner, in place."""
    first, last, radius = found.first, found.last, sequence.radius
    kinds = np.full((len(first), 2), int(EndKind.OCCLUSION))
    margin = parameters.depth_margin + SIGMAS * noise
    depth = np.concatenate(([-np.inf], radius, [-np.inf]))
    kinds[depth[first] > (radius + margin)[first], 0] = EndKind.FREE
    kinds[depth[last + 2] > (radius + margin)[last], 1] = EndKind.FREE
    if len(first) > 1:
        corner, meeting = _corners(sequence, found, parameters)
        found.end[:-1][corner] = found.start[1:][corner] = meeting[corner]
        kinds[:-1, 1][corner] = kinds[1:, 0][corner] = EndKind.CORNER
    return kinds


def _corners(sequence: PointSequence, found: _Fitted, parameters: SegmentParameters) -> tuple[BoolArray, ComplexArray]:
    """Return where a segment and the next meet in a corner ``(S - 1,)``, and the intersections of their lines [m]."""
    first, last, start, end = found.first, found.last, found.start, found.end
    before, after = found.along[:-1], found.along[1:]
    cross = (before.conj() * after).imag
    crossing = np.abs(cross) >= _MIN_CORNER_SINE
    beyond = ((start[1:] - end[:-1]).conj() * after).imag / np.where(crossing, cross, 1.0)
    meeting = end[:-1] + beyond * before
    reach = SAME + np.abs(sequence.points[first[1:]] - sequence.points[last[:-1]])
    half = 0.5 * np.abs(end - start)
    corner = crossing & (np.abs(beyond) < reach) & (np.abs(start[1:] - meeting) < np.minimum(reach, half[1:]))
    corner &= beyond > -half[:-1]
    breaks = sequence.breaks.nonzero()[0]
    corner &= first[1:] - last[:-1] <= _MAX_CORNER_POINTS
    corner &= breaks.searchsorted(first[1:]) == breaks.searchsorted(last[:-1])
    return corner, meeting


_MAX_BEND = 0.15
"""Root mean square distance from the line, as a fraction of the length, above which a segment is dropped."""
_MIN_STEPS = 2
"""Minimum number of steps from the first to the last point of a piece."""
_JOINS = 2
"""Number of passes in which neighbouring pieces are joined."""
_JOIN_ANGLE, _JOIN_ANGLE_NOISE, _MAX_JOIN_ANGLE = 0.05, 6.0, 0.25
"""Neighbouring pieces are joined up to this angle [rad]: base value, growth with noise / length, upper limit [rad]."""
_MIN_CORNER_SINE = 0.3
"""Least sine of the angle between two lines that meet in a corner."""
_MAX_CORNER_POINTS = 3
"""Two segments can meet in a corner only if the second starts at most this many points after the end of the first."""
