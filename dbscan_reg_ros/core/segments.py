"""Line segments of a scan: breakpoints (Eq. 5), corners (Eq. 6) and line fits (Eq. 7) (section 2.2)."""
import numpy as np

from .corners import slope_stretches
from .line_fit import fit_lines, fit_sections, point_moments, summed_moments
from .parameters import SegmentParameters
from .records import EndKind, Segments


def find_breaks(points, radius, beams, geometry, noise, parameters: SegmentParameters):
    """Where neighbouring points of a scan lie too far apart to be one surface (Eq. 5).

    Parameters
    ----------
    points : (P, 2) array
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
    step = points[1:] - points[:-1]
    distance = np.hypot(step[:, 0], step[:, 1])
    gap = beams[1:] - beams[:-1]
    threshold = parameters.breakpoint_factor * abs(geometry.angle_increment) * gap * np.minimum(radius[1:], radius[:-1])
    threshold += parameters.breakpoint_noise * noise
    return (distance >= threshold) | (gap > parameters.max_gap)


def split_runs(points, breaks, noise, parameters: SegmentParameters):
    """First point of each straight stretch: runs cut at their corners, all at once, level by level.

    Within each stretch the point farthest from the chord becomes a corner when it lies more than the split distance
    from it.

    Returns
    -------
    (S,) int array
        Indices into `points`, ascending, first one 0.
    """
    size = len(points)
    x, y = points[:, 0], points[:, 1]
    split_distance = parameters.split_noise * noise + parameters.split_distance
    first = np.concatenate(([0], np.flatnonzero(breaks) + 1))
    starts = np.zeros(size, dtype=bool)
    starts[first] = True
    for _ in range(parameters.split_levels):
        count = np.diff(first, append=size)
        last = first + count - 1
        ax, ay = x[first], y[first]
        ux, uy = x[last] - ax, y[last] - ay
        chord = np.hypot(ux, uy)
        scale = 1.0 / np.maximum(chord, 1e-9)
        stretch = np.repeat(np.arange(len(first)), count)
        distance = np.abs((ux * scale)[stretch] * (y - ay[stretch]) - (uy * scale)[stretch] * (x - ax[stretch]))
        farthest = np.maximum.reduceat(distance, first)
        at = np.flatnonzero((distance == farthest[stretch]) & (distance > split_distance))
        at = at[(at < last[stretch[at]]) & (at > first[stretch[at]])]
        if not len(at):
            break
        starts[at + 1] = True
        first = np.flatnonzero(starts)
    return first


def extract_segments(points, radius, beams, breaks, noise, parameters: SegmentParameters) -> Segments:
    """The line segments of one scan, longest runs of points that lie on one line.

    Parameters
    ----------
    points, radius, beams, breaks
        As in `find_breaks`.
    noise : float
        Standard deviation of a range [m].
    parameters : SegmentParameters

    Returns
    -------
    Segments
        In beam order.
    """
    if parameters.corners == 'slope':
        first, last = slope_stretches(points, radius, breaks, noise, parameters)
        count = last - first + 1
        centre, angle, spread, residual = fit_sections(summed_moments(points), first, last, parameters.sections)
    else:
        first, last, count, moments = _straight_stretches(points, breaks, noise, parameters)
        if parameters.sections:
            count = last - first + 1
            centre, angle, spread, residual = fit_sections(summed_moments(points), first, last, parameters.sections)
        else:
            centre, angle, spread, residual = fit_lines(moments, np.maximum(count, 1))
    along = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    forward = ((points[last] - points[first]) * along).sum(axis=1)
    along[forward < 0.0] *= -1.0
    start = centre + along * ((points[first] - centre) * along).sum(axis=1, keepdims=True)
    end = centre + along * ((points[last] - centre) * along).sum(axis=1, keepdims=True)
    length = np.hypot(*(end - start).T)
    keep = (count >= parameters.min_points) & (length >= parameters.min_length)
    keep &= residual < (0.15 * length) ** 2
    start, end, along, first, last = start[keep], end[keep], along[keep], first[keep], last[keep]
    count, residual, spread = count[keep], residual[keep], spread[keep]
    sigma = np.sqrt(noise * noise + residual)
    kinds, start, end = _end_kinds(points, radius, start, end, along, first, last, noise, parameters)
    length = np.hypot(*(end - start).T)
    return Segments(start, end, np.arctan2(along[:, 1], along[:, 0]), length,
                    sigma / np.sqrt(np.maximum(count * spread, 1e-12)), sigma / np.sqrt(count), kinds,
                    np.stack((beams[first], beams[last]), axis=1))


def _straight_stretches(points, breaks, noise, parameters):
    """Stretches of the runs cut at their corners, neighbours on one line joined, with their moments.

    Returns
    -------
    first, last, count : (S,) int arrays
    moments : (S, 5) array
    """
    first = split_runs(points, breaks, noise, parameters)
    count = np.diff(first, append=len(points))
    last = first + count - 1
    moments = np.add.reduceat(point_moments(points), first, axis=0)
    keep = count >= 3
    first, last, count, moments = first[keep], last[keep], count[keep], moments[keep]
    for _ in range(2):
        if len(first) < 2:
            break
        group = _collinear_groups(points, first, last, count, moments, noise, parameters)
        if group is None:
            break
        head = np.flatnonzero(np.diff(group, prepend=-1))
        tail = np.append(head[1:], len(group)) - 1
        first, last = first[head], last[tail]
        count, moments = np.add.reduceat(count, head), np.add.reduceat(moments, head, axis=0)
    return first, last, count, moments


def _collinear_groups(points, first, last, count, moments, noise, parameters):
    """Number of the group that each stretch belongs to once neighbours on one line are joined; None if none are."""
    _, _, _, residual = fit_lines(moments[1:] + moments[:-1], count[1:] + count[:-1])
    gap = points[first[1:]] - points[last[:-1]]
    reach = points[last] - points[first]
    _, angle, _, _ = fit_lines(moments, count)
    turn = np.abs((np.diff(angle) + 0.5 * np.pi) % np.pi - 0.5 * np.pi)
    length = np.hypot(reach[:, 0], reach[:, 1])
    shorter = np.minimum(length[1:], length[:-1])
    join = residual < (parameters.join_noise * noise) ** 2
    join &= np.hypot(gap[:, 0], gap[:, 1]) < parameters.join_gap
    join &= (reach[1:] * reach[:-1]).sum(axis=1) > 0.0
    join &= turn < np.minimum(0.25, 0.05 + 6.0 * noise / np.maximum(shorter, 1e-3))
    if not join.any():
        return None
    return np.concatenate(([0], np.cumsum(~join)))


def _end_kinds(points, radius, start, end, along, first, last, noise, parameters):
    """What ends each segment; ends at a corner move to the point where its two lines meet."""
    size = len(first)
    kinds = np.full((size, 2), EndKind.OCCLUSION, dtype=int)
    if not size:
        return kinds, start, end
    margin = parameters.depth_margin + 3.0 * noise
    before, after = first - 1, last + 1
    inside = before >= 0
    deeper = radius[np.maximum(before, 0)] > radius[first] + margin
    kinds[inside & deeper, 0] = EndKind.FREE
    inside = after < len(points)
    deeper = radius[np.minimum(after, len(points) - 1)] > radius[last] + margin
    kinds[inside & deeper, 1] = EndKind.FREE
    if size > 1:
        start, end = start.copy(), end.copy()
        cross = along[:-1, 0] * along[1:, 1] - along[:-1, 1] * along[1:, 0]
        between = start[1:] - end[:-1]
        safe = np.where(np.abs(cross) < 0.3, 1.0, cross)
        beyond = (between[:, 0] * along[1:, 1] - between[:, 1] * along[1:, 0]) / safe
        meeting = end[:-1] + beyond[:, None] * along[:-1]
        before_start = np.hypot(*(start[1:] - meeting).T)
        spacing = np.hypot(*(points[first[1:]] - points[last[:-1]]).T)
        reach = parameters.corner_reach + spacing
        corner = (np.abs(cross) >= 0.3) & (np.abs(beyond) < reach) & (before_start < reach)
        corner &= first[1:] - last[:-1] <= 3
        end[:-1][corner] = meeting[corner]
        start[1:][corner] = meeting[corner]
        kinds[:-1, 1][corner] = EndKind.CORNER
        kinds[1:, 0][corner] = EndKind.CORNER
    return kinds, start, end
