# SPDX-License-Identifier: Apache-2.0
"""Ring band filter: judges each beam by the slopes in the ring of beams around it (section 2.1, Eq. 3-4)."""
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from ..geometry.se2 import as_complex, wrap
from ..parameters.features import RingBandParameters

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

    A beam is a *candidate* when it is an outlier of its own ring; ``C1`` and ``C2`` count the outliers in the inner
    (3 beams) and the outer (7 beams) ring around a candidate, itself included.

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
        candidate, inner, outer, deviation = _consensus_outliers(points, noise, parameters)
    if not candidate.any():
        return points, outcome
    gross = deviation > (parameters.gross_error or np.inf)
    removed = candidate & ((inner >= parameters.inner_threshold) | gross)
    corner = candidate & ~removed & (outer >= parameters.outer_threshold)
    smoothed = candidate & ~removed & ~corner
    filtered = points.copy()
    if smoothed.any():
        mean, complete = _inner_mean(points)
        smoothed &= complete
        filtered[smoothed] = mean[smoothed]
    filtered[removed] = np.nan
    outcome[smoothed], outcome[corner], outcome[removed] = Outcome.SMOOTHED, Outcome.CORNER, Outcome.REMOVED
    return filtered, outcome


def _inner_mean(points):
    mean = np.full_like(points, np.nan)
    mean[1:-1] = (points[:-2] + points[1:-1] + points[2:]) / 3.0
    return mean, np.isfinite(mean[:, 0])


def _anchor_outliers(points, parameters):
    """The paper's test: slopes from the beam before the ring (Eq. 3) against the ring's median slope.

    Beams without a return are passed over. The first four and the last three returns have no full ring and are not
    judged, nor are rings across a range jump: neighbours, the candidate left out, farther apart than `jump`.
    """
    size = len(points)
    candidate, inner, outer = np.zeros(size, dtype=bool), np.zeros(size, dtype=int), np.zeros(size, dtype=int)
    deviation = np.zeros(size)
    at = np.flatnonzero(np.isfinite(points[:, 0]))
    rings = len(at) - 2 * RING - 1
    if rings < 1:
        return candidate, inner, outer, deviation
    band = points[at[np.arange(rings)[:, None] + np.arange(2 * RING + 2)]]
    anchor, ring, centre = band[:, :1], band[:, 1:], at[RING + 1:len(at) - RING]
    slope = np.arctan2(*np.moveaxis(ring - anchor, 2, 0)[::-1])
    slope = wrap(slope - slope[:, RING:RING + 1])
    others = np.delete(band, RING + 1, axis=1)
    widest = np.hypot(*np.moveaxis(np.diff(others, axis=1), 2, 0)).max(axis=1)
    outlier = np.abs(slope - np.median(slope, axis=1, keepdims=True)) > parameters.slope_tolerance
    outlier &= (widest <= parameters.jump)[:, None]
    candidate[centre] = outlier[:, RING]
    inner[centre] = outlier[:, RING - INNER:RING + INNER + 1].sum(axis=1)
    outer[centre] = outlier.sum(axis=1)
    deviation[centre] = np.hypot(*(ring[:, RING] - 0.5 * (ring[:, RING - 1] + ring[:, RING + 1])).T)
    return candidate, inner, outer, deviation


class _Lines(NamedTuple):
    """Pairs of beams near a centre, T of them, and for each a third that may lie on the line through both.

    Attributes
    ----------
    beams : (3, T, 1) int array
        Offsets from ``centre - RING`` to the third, the first and the second beam.
    growth : (T, 1) array
        How the noise of the two grows on the way to the third, and that of the third, 1.
    """

    beams: np.ndarray
    growth: np.ndarray


def _lines(triples):
    k, a, b = triples = np.array(triples).T[:, :, None]
    return _Lines(triples + RING, 1.0 + (np.abs(a - k) + np.abs(b - k)) / (b - a))


_BEFORE, _AFTER = tuple(range(-RING, 0)), tuple(range(1, RING + 1))
_ONE_SIDED = [(0, a, b) for side in (_BEFORE, _AFTER) for a in side for b in side if a < b]
_ACROSS = _lines([(k, a, b) for k in _BEFORE + _AFTER for _, a, b in _ONE_SIDED if a * k < 0])
_THROUGH = _lines(_ONE_SIDED + [(0, a, b) for a in _BEFORE for b in _AFTER])
_NEAREST = _lines([(0, -2, -1), (0, -1, 1), (0, 1, 2)])


def _consensus_outliers(points, noise, parameters):
    """Our test. Where most returns have none on the next beam, the beams without one are passed over."""
    known = np.isfinite(points[:, 0])
    if 2 * np.count_nonzero(known[1:] & known[:-1]) >= np.count_nonzero(known) - 1:
        return _judged_by_lines(points, noise, parameters)
    found = _judged_by_lines(points[known], noise, parameters)
    spread = [np.zeros(len(points), dtype=each.dtype) for each in found]
    for whole, part in zip(spread, found, strict=True):
        whole[known] = part
    return spread


def _judged_by_lines(points, noise, parameters):
    """An outlier lies on no line through two other beams of its ring.

    So a wild anchor does no harm, and a corner, which lies on the lines of both its walls, is no outlier. Where the
    three beams before and the three after the candidate are straight, two astride make no line: it would cut the corner
    off. Around a candidate, ring beams on no line through two beams across from it count as outliers, too.
    """
    size = len(points)
    known = np.isfinite(points[:, 0])
    padded = np.full(size + 2 * RING, np.nan, dtype=complex)
    padded[RING:-RING] = as_complex(points)
    deviation, tolerance = _off_lines(padded, np.arange(size), _NEAREST, noise, parameters)
    before, astride, after = deviation <= tolerance
    straight = np.zeros(size + 4, dtype=bool)
    straight[2:-2] = astride
    corner = straight[:-4] & straight[4:]
    doubtful = (known & ~(before | after | astride & ~corner)).nonzero()[0]
    candidate, deviation = np.zeros(size, dtype=bool), np.zeros(size)
    distance, tolerance = _off_lines(padded, doubtful, _THROUGH, noise, parameters)
    on = distance <= tolerance
    candidate[doubtful] = ~(on[:len(_ONE_SIDED)].any(axis=0) | on[len(_ONE_SIDED):].any(axis=0) & ~corner[doubtful])
    deviation[doubtful] = distance.min(axis=0)
    inner, outer = candidate.astype(int), candidate.astype(int)
    counted = candidate if parameters.gross_error == 0.0 else candidate & (deviation <= parameters.gross_error)
    at = counted.nonzero()[0]
    if len(at):
        distance, tolerance = _off_lines(padded, at, _ACROSS, noise, parameters)
        shape = (2 * RING, -1, len(at))
        outlier = np.isfinite(distance).reshape(shape).any(axis=1) & ~(distance <= tolerance).reshape(shape).any(axis=1)
        inner[at] += outlier[RING - INNER:RING + INNER].sum(axis=0)
        outer[at] += outlier.sum(axis=0)
    return candidate, inner, outer, deviation


def _off_lines(padded, centre, lines, noise, parameters):
    """How far the third beam of each of the `lines` lies from it, along the beam.

    Parameters
    ----------
    padded : (N + 2 * RING,) complex array
        Points; `nan` without a return.
    centre : (S,) int array
    lines : _Lines

    Returns
    -------
    distance, tolerance : (T, S) arrays [m]
        The distance is `inf` where one of the three has no return. The tolerance grows as the noise of the two does
        on the way to the third.
    """
    beam, one, two = padded.take(lines.beams + centre)
    radius = np.abs(beam)
    # The line through `one` and `two` meets the beam p s at s = cross(one, two) / cross(p, two - one).
    with np.errstate(divide='ignore', invalid='ignore'):
        meeting = (one.conj() * two).imag / (beam.conj() * (two - one)).imag
        distance = np.abs(meeting - 1.0) * radius
    distance[np.isnan(distance)] = np.inf
    tolerance = parameters.relative_tolerance * radius
    tolerance += parameters.noise_factor * noise * lines.growth
    return distance, tolerance
