# SPDX-License-Identifier: Apache-2.0
"""Ring band filter: each beam is compared with the ring of beams around it (section 2.1, Eq. 3-4)."""
import numpy as np

from ..features.ring_band import Outcome
from ..geometry.array_types import FloatArray, IntArray
from ..geometry.se2 import wrap

RING, INNER = 3, 1
"""Beams of the outer and of the inner ring on each side of a beam."""
_SLOPE_TOLERANCE = 0.1
"""Open: a slope is an outlier if it is this far [rad] from the median slope of its ring."""
_JUMP = 0.5
"""Open: a ring is not judged if two neighbours in it, without the beam itself, lie farther apart than this [m]."""
_INNER_THRESHOLD, _OUTER_THRESHOLD = 2, 3
"""Open: T1 and T2 of Eq. 4. A count equal to its threshold counts as above it."""


def ring_band_filter(points: FloatArray) -> tuple[FloatArray, IntArray]:
    """Filter the points of a scan by Eq. 4.

    Beams without a return are skipped. The first four and the last three returns have no full ring and are kept.

    Parameters
    ----------
    points : (N, 2) float
        Points in beam order [m]; not finite where a beam has no return.

    Returns
    -------
    filtered : (N, 2) float
        Removed points are ``nan``.
    outcome : (N,) int
        `Outcome` of each beam: the four regions of Figure 2.
    """
    filtered, outcome = points.copy(), np.zeros(len(points), dtype=int)
    returns = np.flatnonzero(np.isfinite(points[:, 0]))
    rings = len(returns) - 2 * RING - 1
    if rings < 1:
        return filtered, outcome
    # Eq. 3: slopes of the ring, from the beam before it. Column 0 of `band` is that beam, column RING + 1 the centre.
    band = points[returns[np.arange(rings)[:, None] + np.arange(2 * RING + 2)]]
    centre, ring = returns[RING + 1:len(returns) - RING], band[:, 1:] - band[:, :1]
    slope = np.arctan2(ring[..., 1], ring[..., 0])
    slope = wrap(slope - slope[:, RING:RING + 1])
    outlier = np.abs(slope - np.median(slope, axis=1, keepdims=True)) > _SLOPE_TOLERANCE
    steps = np.diff(np.delete(band, RING + 1, axis=1), axis=1)
    outlier &= (np.hypot(steps[..., 0], steps[..., 1]).max(axis=1) <= _JUMP)[:, None]
    # Eq. 4: C1 and C2 count the outliers of the inner and the outer ring, the beam itself included.
    candidate = outlier[:, RING]
    c1, c2 = outlier[:, RING - INNER:RING + INNER + 1].sum(axis=1), outlier.sum(axis=1)
    removed = candidate & (c1 >= _INNER_THRESHOLD)
    corner = candidate & ~removed & (c2 >= _OUTER_THRESHOLD)
    mean = np.full_like(points, np.nan)
    mean[1:-1] = (points[:-2] + points[1:-1] + points[2:]) / (2 * INNER + 1)
    smoothed = candidate & ~removed & ~corner & np.isfinite(mean[centre, 0])
    filtered[centre[smoothed]] = mean[centre[smoothed]]
    filtered[centre[removed]] = np.nan
    for chosen, kind in (smoothed, Outcome.SMOOTHED), (corner, Outcome.CORNER), (removed, Outcome.REMOVED):
        outcome[centre[chosen]] = kind
    return filtered, outcome
