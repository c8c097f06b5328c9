# SPDX-License-Identifier: Apache-2.0
"""Ring band filter: tests each beam against the ring of beams around it (section 2.1, Eq. 3-4)."""
import itertools
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.se2 import as_complex
from ..geometry.tolerance import SIGMAS
from ..parameters.features import RingBandParameters

RING = 3
"""Number of beams of the outer ring on each side of a beam."""
INNER = 1
"""Number of beams of the inner ring on each side of a beam."""


class Outcome(IntEnum):
    """Result of the ring band filter for a beam (the four regions of Figure 2)."""

    KEPT = 0
    """The beam is no outlier, or has no return."""
    SMOOTHED = 1
    """Noise: the point is replaced by the mean of the inner ring."""
    CORNER = 2
    """An outlier beside many other outliers: it is taken as a corner and kept as measured."""
    REMOVED = 3
    """Noise next to a corner, or a gross outlier: the point is removed."""


class _Outliers(NamedTuple):
    """Result of an outlier test.

    Attributes
    ----------
    candidate : (N,) bool
        Beams that are outliers in the ring around them.
    inner, outer : (N,) int
        Number of outliers in the inner and in the outer ring around each candidate, the candidate included.
    deviation : (N,) float [m]
        Distance of each candidate from the line of its neighbours.
    """

    candidate: BoolArray
    inner: IntArray
    outer: IntArray
    deviation: FloatArray


def ring_band_filter(points: FloatArray, noise: float,
                     parameters: RingBandParameters) -> tuple[FloatArray, IntArray]:
    """Filter the points of a scan according to Eq. 4.

    A beam is a candidate when it is an outlier in the ring around it; ``C1`` and ``C2`` count the outliers in the inner
    (3 beams) and the outer (7 beams) ring around a candidate, the candidate included.

    Parameters
    ----------
    points : (N, 2) float
        Points in beam order [m]; not finite where a beam has no return.
    noise : float
        Standard deviation of a range [m].
    parameters : RingBandParameters

    Returns
    -------
    filtered : (N, 2) float
        Removed points are ``nan``.
    outcome : (N,) int
        `Outcome` of each beam.
    """
    outcome = np.zeros(len(points), dtype=int)
    if parameters.test == 'off' or len(points) <= 2 * INNER:
        return points, outcome
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


def _inner_mean(points: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the mean point of the inner ring of each beam ``(N, 2)`` [m], and where that ring is complete ``(N,)``."""
    mean = np.full_like(points, np.nan)
    mean[1:-1] = (points[:-2] + points[1:-1] + points[2:]) / (2 * INNER + 1)
    return mean, np.isfinite(mean[:, 0])


class _Lines(NamedTuple):
    """T pairs of beams near a centre beam, and for each pair a third beam that may lie on the line through the pair.

    Attributes
    ----------
    beams : (3, T, 1) int
        Offsets from ``centre - RING`` to the third, the first and the second beam.
    growth : (T, 1) float
        Ratio of the noise of the distance between the third beam and the line to the noise of a range.
    """

    beams: IntArray
    growth: FloatArray


def _lines(triples: list[tuple[int, int, int]]) -> _Lines:
    """Make `_Lines` from triples of offsets from the centre beam: of the third, the first and the second beam."""
    table = np.array(triples).T[:, :, None]
    k, a, b = table
    return _Lines(table + RING, 1.0 + (np.abs(a - k) + np.abs(b - k)) / (b - a))


_AFTER = tuple(range(1, RING + 1))
_BEFORE = tuple(-k for k in reversed(_AFTER))
_ONE_SIDED = [(0, a, b) for side in (_BEFORE, _AFTER) for a in side for b in side if a < b]
_ACROSS = _lines([(k, a, b) for k in _BEFORE + _AFTER for _, a, b in _ONE_SIDED if a * k < 0])
_THROUGH = _lines(_ONE_SIDED + [(0, a, b) for a in _BEFORE for b in _AFTER])
_NEAREST = _lines([(0, a, b) for a, b in itertools.pairwise(_BEFORE[1:] + _AFTER[:-1])])


def _consensus_outliers(points: FloatArray, noise: float, parameters: RingBandParameters) -> _Outliers:
    """Find outliers by the consensus test; if most returns have no neighbour, beams without a return are skipped."""
    known = np.isfinite(points[:, 0])
    if 2 * np.count_nonzero(known[1:] & known[:-1]) >= np.count_nonzero(known) - 1:
        return _outliers_by_lines(points, noise, parameters)
    found = _outliers_by_lines(points[known], noise, parameters)
    size = len(points)
    spread = _Outliers(np.zeros(size, dtype=bool), np.zeros(size, dtype=int), np.zeros(size, dtype=int), np.zeros(size))
    for whole, part in zip(spread, found, strict=True):
        whole[known] = part
    return spread


def _outliers_by_lines(points: FloatArray, noise: float, parameters: RingBandParameters) -> _Outliers:
    """Find beams that lie on no line through two other beams of their ring.

    A single wild beam cannot make other beams outliers. A corner is no outlier, because it lies on the lines of both
    of its walls. Where the three beams before and the three after the candidate each lie on a line, pairs with one beam
    on each side are not used, because their lines cut the corner off. Near a candidate, a beam also counts as an
    outlier if it lies on no line through two beams on the opposite side of the candidate.
    """
    size = len(points)
    known = np.isfinite(points[:, 0])
    padded = np.full(size + 2 * RING, np.nan, dtype=complex)
    padded[RING:-RING] = as_complex(points)
    deviation, tolerance = _off_lines(padded, np.arange(size), _NEAREST, noise, parameters)
    before, astride, after = deviation <= tolerance
    straight = np.zeros(size + 2 * 2, dtype=bool)
    straight[2:-2] = astride
    corner = straight[:size] & straight[-size:]
    suspect = (known & ~(before | after | astride & ~corner)).nonzero()[0]
    candidate, deviation = np.zeros(size, dtype=bool), np.zeros(size)
    distance, tolerance = _off_lines(padded, suspect, _THROUGH, noise, parameters)
    on = distance <= tolerance
    one_sided, both_sided = on[:len(_ONE_SIDED)].any(axis=0), on[len(_ONE_SIDED):].any(axis=0)
    candidate[suspect] = ~(one_sided | both_sided & ~corner[suspect])
    deviation[suspect] = distance.min(axis=0)
    inner, outer = candidate.astype(int), candidate.astype(int)
    counted = candidate if parameters.gross_error == 0.0 else candidate & (deviation <= parameters.gross_error)
    centre = counted.nonzero()[0]
    if len(centre):
        distance, tolerance = _off_lines(padded, centre, _ACROSS, noise, parameters)
        shape = (2 * RING, -1, len(centre))
        tested, on_line = (each.reshape(shape).any(axis=1) for each in (np.isfinite(distance), distance <= tolerance))
        outlier = np.logical_and(tested, ~on_line)
        inner[centre] += outlier[RING - INNER:RING + INNER].sum(axis=0)
        outer[centre] += outlier.sum(axis=0)
    return _Outliers(candidate, inner, outer, deviation)


def _off_lines(padded: ComplexArray, centre: IntArray, lines: _Lines, noise: float,
               parameters: RingBandParameters) -> tuple[FloatArray, FloatArray]:
    """Return the distance of the third beam from each of the `lines`, along that beam, and the tolerated distance.

    Parameters
    ----------
    padded : (N + 2 * RING,) complex
        Points [m]; `nan` without a return.
    centre : (S,) int
        Centre beams of the lines.
    lines : _Lines
    noise : float
        Standard deviation of a range [m].
    parameters : RingBandParameters

    Returns
    -------
    distance, tolerance : (T, S) float [m]
        The distance is `inf` where one of the three beams has no return.
    """
    beam, one, two = padded.take(lines.beams + centre)
    radius = np.abs(beam)
    # The line through `one` and `two` meets the beam p s at s = cross(one, two) / cross(p, two - one).
    with np.errstate(divide='ignore', invalid='ignore'):
        meeting = (one.conj() * two).imag / (beam.conj() * (two - one)).imag
        distance = np.abs(meeting - 1.0) * radius
    distance[np.isnan(distance)] = np.inf
    tolerance = parameters.relative_tolerance * radius
    tolerance += SIGMAS * noise * lines.growth
    return distance, tolerance
