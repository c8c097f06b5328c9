"""Ring band filter: judges each beam by the slopes in the ring of beams around it (section 2.1, Eq. 3-4)."""
from enum import IntEnum

import numpy as np

from .parameters import RingBandParameters

RING = 3
INNER = 1


class Outcome(IntEnum):
    """What the filter did with a beam (the four regions of Figure 2)."""

    KEPT = 0
    """Not an outlier, or no return at all."""
    SMOOTHED = 1
    """Noise: replaced by the mean of the inner ring."""
    CORNER = 2
    """An outlier beside many others: a corner, kept as measured."""
    REMOVED = 3
    """Noise next to a corner, or a gross outlier."""


def ring_band_filter(points, noise, parameters: RingBandParameters):
    """Filter the points of a scan by Eq. 4.

    A beam is a *candidate* when it is an outlier among the slopes of its own ring; ``C1`` and ``C2`` count the
    outliers in the inner (3 beams) and the outer (7 beams) ring around a candidate.

    Parameters
    ----------
    points : (N, 2) array
        Points in beam order [m]; not finite where a beam has no return.
    noise : float
        Standard deviation of a range [m].
    parameters : RingBandParameters

    Returns
    -------
    filtered : (N, 2) array
        Removed points are ``nan``.
    outcome : (N,) int8 array of `Outcome`
    """
    outcome = np.zeros(len(points), dtype=np.int8)
    if parameters.test == 'off' or len(points) < 3:
        return points, outcome
    if parameters.test == 'anchor':
        candidate, inner, outer, deviation = _anchor_outliers(points, parameters)
    else:
        candidate, deviation = _consensus_outliers(points, noise, parameters)
        inner, outer = _ring_sum(candidate, INNER), _ring_sum(candidate, RING)
    if not candidate.any():
        return points, outcome
    removed = candidate & (inner >= parameters.inner_threshold)
    corner = candidate & ~removed & (outer >= parameters.outer_threshold)
    smoothed = candidate & ~removed & ~corner
    if parameters.gross > 0.0:
        gross = candidate & (deviation > parameters.gross)
        removed |= gross
        corner &= ~gross
        smoothed &= ~gross
    mean, complete = _inner_mean(points)
    smoothed &= complete
    outcome[smoothed], outcome[corner], outcome[removed] = Outcome.SMOOTHED, Outcome.CORNER, Outcome.REMOVED
    filtered = np.where(smoothed[:, None], mean, points)
    filtered[removed] = np.nan
    return filtered, outcome


def _shifted(array, offset, fill):
    """`array` with element ``i + offset`` at ``i``; `fill` beyond the ends."""
    out = np.full_like(array, fill)
    if offset > 0:
        out[:-offset] = array[offset:]
    elif offset < 0:
        out[-offset:] = array[:offset]
    else:
        out[:] = array
    return out


def _ring_sum(flags, reach):
    count = np.zeros(len(flags), dtype=np.int8)
    for offset in range(-reach, reach + 1):
        count += _shifted(flags, offset, False)
    return count


def _inner_mean(points):
    before, after = _shifted(points, -1, np.nan), _shifted(points, 1, np.nan)
    mean = (before + points + after) / 3.0
    return mean, np.isfinite(mean[:, 0])


def _anchor_outliers(points, parameters):
    """The paper's test: slopes from the beam before the ring (Eq. 3) against the ring's median slope.

    A ring without its anchor, its candidate or at least five of its points is not judged, nor is one that spans a
    range jump: neighbours farther apart than `jump`.
    """
    ring = np.stack([_shifted(points, offset, np.nan) for offset in range(-RING, RING + 1)], axis=1)
    step = ring - _shifted(points, -RING - 1, np.nan)[:, None]
    slope = np.arctan2(step[..., 1], step[..., 0])
    slope = (slope - slope[:, RING:RING + 1] + np.pi) % (2.0 * np.pi) - np.pi
    known = np.isfinite(slope).sum(axis=1)
    ordered = np.sort(slope, axis=1)
    rows = np.arange(len(points))
    middle = np.maximum(known - 1, 0)
    median = 0.5 * (ordered[rows, middle // 2] + ordered[rows, (middle + 1) // 2])
    with np.errstate(invalid='ignore'):
        outlier = np.abs(slope - median[:, None]) > parameters.slope_tolerance
        widest = np.hypot(*np.moveaxis(np.diff(ring, axis=1), 2, 0))
        judged = (known >= 5) & ~(widest > parameters.jump).any(axis=1) & np.isfinite(slope[:, RING])
    outlier &= judged[:, None]
    inner = outlier[:, RING - INNER:RING + INNER + 1].sum(axis=1)
    before, after = _shifted(points, -1, np.nan), _shifted(points, 1, np.nan)
    deviation = np.nan_to_num(np.hypot(*(points - 0.5 * (before + after)).T))
    return outlier[:, RING], inner, outlier.sum(axis=1), deviation


# Which pairs of ring beams predict the candidate, and how much their noise grows on the way.
_PAIRS = tuple((a, b) for a in range(-RING, RING + 1) for b in range(a + 1, RING + 1) if a and b)


def _consensus_outliers(points, noise, parameters):
    """Our test: an outlier lies on no line through two other beams of its ring.

    Any two ring beams may serve as anchor and slope, so that a wild anchor does no harm and a corner, which lies on
    the lines of both its walls, is none. The deviation is taken along the beam.
    """
    missing = np.isfinite(points[:, 0])
    np.logical_not(missing, out=missing)
    x, y = np.where(missing, 0.0, points[:, 0]), np.where(missing, 0.0, points[:, 1])
    size = len(points)
    padded = np.zeros((2, size + 2 * RING))
    padded[0, RING:-RING], padded[1, RING:-RING] = x, y
    first = np.array([RING + a for a, _ in _PAIRS])[:, None] + np.arange(size)
    second = np.array([RING + b for _, b in _PAIRS])[:, None] + np.arange(size)
    ax, ay, bx, by = padded[0].take(first), padded[1].take(first), padded[0].take(second), padded[1].take(second)
    radius = np.hypot(x, y)
    # The line a-b meets the beam (x, y) s at s = cross(a, b) / cross(p, b - a).
    area = ax * by - ay * bx
    facing = x * (by - ay) - y * (bx - ax)
    with np.errstate(divide='ignore', invalid='ignore'):
        deviation = np.abs(area / facing - 1.0) * radius
    growth = np.array([(abs(a) + abs(b)) / (b - a) for a, b in _PAIRS])[:, None]
    tolerance = parameters.noise_factor * noise * (1.0 + growth) + parameters.relative_tolerance * radius
    absent = (ax == 0.0) & (ay == 0.0) | (bx == 0.0) & (by == 0.0)
    deviation[absent | np.isnan(deviation)] = np.inf
    outlier = ~((deviation <= tolerance).any(axis=0) | missing)
    return outlier, deviation.min(axis=0)
