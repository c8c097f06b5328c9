# SPDX-License-Identifier: Apache-2.0
"""Line segments of a scan: breakpoints (Eq. 5), corners (Eq. 6) and line fits (Eq. 7) (section 2.2)."""
import numpy as np

from ..geometry.line_fit import fit_lines, fit_sections
from ..geometry.se2 import as_vectors
from ..parameters.features import SegmentParameters
from .corners import slope_stretches
from .records import EndKind, Segments


def find_breaks(points, radius, beams, geometry, noise, parameters: SegmentParameters):
    """Where neighbouring points of a scan lie too far apart to be one surface (Eq. 5).

    Parameters
    ----------
    points : (P,) complex array
        Returns in beam order [m].
    radius : (P,) array
        Their ranges [m].
    beams : (P,) int array
        Their beams; a gap of several beams is bridged in proportion.
    geometry : ScanGeometry
    noise : float
        Standard deviation of a range [m].
    parameters : SegmentParameters

    Returns
    -------
    (P - 1,) bool array
        True where a break lies between a point and the next.
    """
    distance = np.abs(points[1:] - points[:-1])
    gap = beams[1:] - beams[:-1]
    threshold = parameters.breakpoint_factor * abs(geometry.angle_increment) * gap * np.minimum(radius[1:], radius[:-1])
    threshold += parameters.breakpoint_noise * noise
    return (distance >= threshold) | (gap > parameters.max_gap)


def split_runs(points, breaks, noise, parameters: SegmentParameters):
    """Straight stretches: runs cut at their corners, all at once, level by level.

    Within each stretch the point that lies farthest from the chord, beyond its own split distance, becomes a corner.

    Returns
    -------
    first, last : (S,) int arrays
        First and last point of each stretch.
    """
    split_distance = np.maximum(parameters.split_noise * noise + parameters.split_distance, 1e-9)
    edges = np.concatenate(([True], breaks, [True]))
    edge = edges.nonzero()[0]
    for _ in range(parameters.split_levels):
        first, length = edge[:-1], edge[1:] - edge[:-1]
        start = points[first]
        chord = points[edge[1:] - 1] - start
        # Distances from a chord beyond the split distance, times its length.
        area = np.abs((chord.conj().repeat(length) * (points - start.repeat(length))).imag)
        area -= split_distance * np.abs(chord).repeat(length)
        largest = np.maximum.reduceat(area, first)
        largest[largest <= 0.0] = np.inf
        at = (area == largest.repeat(length)).nonzero()[0]
        if not len(at):
            break
        edges[at + 1] = True
        edge = edges.nonzero()[0]
    return edge[:-1], edge[1:] - 1


def extract_segments(points, total, radius, beams, breaks, noise, parameters: SegmentParameters) -> Segments:
    """The line segments of one scan, longest runs of points that lie on one line.

    Parameters
    ----------
    points, radius, beams, breaks
        As in `find_breaks`.
    total : (5, P + 1) array
        `summed_moments` of the points.
    noise : (P,) array
        Standard deviation of each range [m].
    parameters : SegmentParameters

    Returns
    -------
    Segments
        In beam order.
    """
    if parameters.corners == 'slope':
        first, last = slope_stretches(points, total, radius, breaks, noise, parameters)
    else:
        first, last, count, lines = _straight_stretches(points, total, breaks, noise, parameters)
    if parameters.corners == 'slope' or parameters.sections:
        count, lines = last - first + 1, fit_sections(total, first, last, parameters.sections)
    (x, y), angle, spread, residual = lines
    centre, along = x + 1j * y, np.exp(1j * angle)
    along[((points[last] - points[first]) * along.conj()).real < 0.0] *= -1.0
    start = centre + along * ((points[first] - centre) * along.conj()).real
    end = centre + along * ((points[last] - centre) * along.conj()).real
    length = np.abs(end - start)
    keep = (count >= parameters.min_points) & (length >= parameters.min_length) & (residual < (0.15 * length) ** 2)
    keep = keep.nonzero()[0]
    if len(keep) > parameters.max_segments:
        keep = np.sort(keep[np.argsort(-length[keep], kind='stable')[:parameters.max_segments]])
    start, end, along, first, last, count, residual, spread = (
        values[keep] for values in (start, end, along, first, last, count, residual, spread))
    sigma = 0.5 * (noise[first] + noise[last])
    sigma = np.sqrt(sigma * sigma + residual)
    kinds = _end_kinds(points, radius, breaks, start, end, along, first, last, noise, parameters)
    return Segments(as_vectors(start), as_vectors(end), np.arctan2(along.imag, along.real), np.abs(end - start),
                    sigma / np.sqrt(np.maximum(count * spread, 1e-12)), sigma / np.sqrt(count), kinds,
                    np.array((beams[first], beams[last])).T)


def _straight_stretches(points, total, breaks, noise, parameters):
    """Stretches of the runs cut at their corners, neighbours on one line joined, with the lines through their points.

    Returns
    -------
    first, last, count : (S,) int arrays
    lines : tuple
        As from `fit_lines`.
    """
    first, last = split_runs(points, breaks, noise, parameters)
    kept = (last - first >= 2).nonzero()[0]
    first, last = first[kept], last[kept]
    count, moments = last - first + 1, total[:, last + 1] - total[:, first]
    for _ in range(_JOINS):
        size = len(first)
        _, angle, _, residual = lines = fit_lines(np.concatenate((moments, moments[:, 1:] + moments[:, :-1]), axis=1),
                                                  np.concatenate((count, count[1:] + count[:-1])))
        apart = _on_different_lines(points, first, last, angle[:size], residual[size:], noise, parameters)
        if apart.all():
            return first, last, count, [each[..., :size] for each in lines]
        head = np.concatenate(([True], apart)).nonzero()[0]
        first, last = first[head], last[np.concatenate((head[1:], [size])) - 1]
        count, moments = np.add.reduceat(count, head), np.add.reduceat(moments, head, axis=1)
    return first, last, count, fit_lines(moments, count)


_JOINS = 2
"""Times that neighbours are joined."""


def _on_different_lines(points, first, last, angle, residual, noise, parameters):
    """``(S - 1,)`` bool: False where a stretch and the next are parts of one line.

    By the `angle` ``(S,)`` of each one's line, and the `residual` ``(S - 1,)`` of that through both.
    """
    turn = np.abs((angle[1:] - angle[:-1] + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
    reach = points[last] - points[first]
    length = np.abs(reach)
    shorter = np.minimum(length[1:], length[:-1])
    noise = np.maximum(noise[last[:-1]], noise[first[1:]])
    same = residual < (parameters.join_noise * noise) ** 2
    same &= np.abs(points[first[1:]] - points[last[:-1]]) < parameters.join_gap
    same &= (reach[1:] * reach[:-1].conj()).real > 0.0
    same &= turn < np.minimum(0.25, 0.05 + 6.0 * noise / np.maximum(shorter, 1e-3))
    return ~same


def _end_kinds(points, radius, breaks, start, end, along, first, last, noise, parameters):
    """What ends each segment; a `start` or `end` at a corner is moved to the point where its two lines meet."""
    kinds = np.full((len(first), 2), int(EndKind.OCCLUSION))
    margin = parameters.depth_margin + 3.0 * noise
    depth = np.concatenate(([-np.inf], radius, [-np.inf]))
    kinds[depth[first] > (radius + margin)[first], 0] = EndKind.FREE
    kinds[depth[last + 2] > (radius + margin)[last], 1] = EndKind.FREE
    if len(first) > 1:
        before, after = along[:-1], along[1:]
        cross = (before.conj() * after).imag
        crossing = np.abs(cross) >= _CROSSING
        beyond = ((start[1:] - end[:-1]).conj() * after).imag / np.where(crossing, cross, 1.0)
        meeting = end[:-1] + beyond * before
        reach = parameters.corner_reach + np.abs(points[first[1:]] - points[last[:-1]])
        half = 0.5 * np.abs(end - start)
        corner = crossing & (np.abs(beyond) < reach) & (np.abs(start[1:] - meeting) < np.minimum(reach, half[1:]))
        corner &= beyond > -half[:-1]
        cut = breaks.nonzero()[0]
        corner &= (first[1:] - last[:-1] <= 3) & (cut.searchsorted(first[1:]) == cut.searchsorted(last[:-1]))
        end[:-1][corner] = start[1:][corner] = meeting[corner]
        kinds[:-1, 1][corner] = kinds[1:, 0][corner] = EndKind.CORNER
    return kinds


# Sine of the least angle between two lines that meet in a corner.
_CROSSING = 0.3
