# SPDX-License-Identifier: Apache-2.0
"""Kernel densities of the coordinates x and y, and their K-L divergence (section 2.3, Eq. 16-21)."""
import math

import numpy as np
from scipy.special import logsumexp

from ..geometry.array_types import FloatArray
from ..geometry.se2 import SE2
from ..geometry.tolerance import RESOLUTION, SIGMAS

_PLACES = 200
"""Open: number of places along each axis at which the densities are compared."""
_NODES = 8
"""Number of nodes per bandwidth at which the density is computed; it is interpolated between them."""


def divergences(candidates: FloatArray, reference: FloatArray, current: FloatArray) -> FloatArray:
    """Return the symmetric K-L divergence of the scans' densities for every candidate, the sum over x and y.

    Parameters
    ----------
    candidates : (C, 3) array
        x, y [m] and theta [rad].
    reference, current : (P, 2), (Q, 2) arrays
        Points [m].

    Returns
    -------
    (C,) array
    """
    total = np.zeros(len(candidates))
    bandwidths = [silverman(column) for column in reference.T]
    for theta in np.unique(candidates[:, 2]):
        at = np.flatnonzero(candidates[:, 2] == theta)
        rotated = SE2(0.0, 0.0, theta).apply(current)
        for axis, bandwidth in enumerate(bandwidths):
            total[at] += shifted_divergences(reference[:, axis], rotated[:, axis], candidates[at, axis], bandwidth)
    return total


def shifted_divergences(reference: FloatArray, current: FloatArray, shifts: FloatArray,
                        bandwidth: float) -> FloatArray:
    """Return the symmetric K-L divergence (Eq. 19-21) of two sets of numbers for `shifts` of the second.

    The sums of Eq. 19-20 run over places that cover both sets, times the step between them, and
    approximate integrals. A shift only translates a density, so each density is estimated once.

    Parameters
    ----------
    reference : (P,) array
    current : (Q,) array
    shifts : (C,) array
    bandwidth : float

    Returns
    -------
    (C,) array
    """
    from scipy.interpolate import CubicSpline
    margin = SIGMAS * bandwidth
    low = min(reference.min(), current.min() + shifts.min()) - margin
    high = max(reference.max(), current.max() + shifts.max()) + margin
    grid = np.linspace(low, high, _PLACES)
    first, last = low - shifts.max(), high - shifts.min()
    nodes = np.linspace(first, last, max(int(_NODES * (last - first) / bandwidth), 2) + 1)
    log_p = CubicSpline(nodes, log_density(current, bandwidth, nodes))(grid - shifts[:, None])
    log_q = log_density(reference, bandwidth, grid)
    divergence: FloatArray = ((np.exp(log_p) - np.exp(log_q)) * (log_p - log_q)).sum(axis=1) * (grid[1] - grid[0])
    return divergence


def log_density(samples: FloatArray, bandwidth: float, at: FloatArray) -> FloatArray:
    """Return the logarithm of the Gaussian kernel density estimate of `samples` ``(n,)`` at `at` (Eq. 16-18)."""
    exponent = -0.5 * ((at[:, None] - samples) / bandwidth) ** 2
    density: FloatArray = logsumexp(exponent, axis=1) - math.log(len(samples) * bandwidth * math.sqrt(2.0 * math.pi))
    return density


def silverman(samples: FloatArray) -> float:
    """Return the bandwidth h [m] of Eq. 16 (open): Silverman's rule ``s (4 / 3n)^(1/5)``, at least 1 mm."""
    return float(max(float(np.std(samples, ddof=1)) * (0.75 * len(samples)) ** -0.2, RESOLUTION))
