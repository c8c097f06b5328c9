# SPDX-License-Identifier: Apache-2.0
"""Selection within the key clusters: kernel densities of x and y, K-L divergence (section 2.3, Eq. 16-21)."""
import math
from functools import partial

import numpy as np
from scipy.special import logsumexp

from ...geometry.array_types import FloatArray
from ...geometry.se2 import DOF, SE2
from ...geometry.tolerance import RESOLUTION, SIGMAS
from ...parameters.registration import DivergenceParameters
from ..records import Hypothesis, Registration, Status
from ..rotation import Rotations, wrap_period
from ..scoring import score
from ..search import Problem
from ..status import failed, match_segments
from ..translation import Translations

KEY_CLUSTERS = 2
"""The samples of this many largest translation clusters are compared, because Eq. 15 has two signs."""
_NODES = 8
"""Number of nodes per bandwidth at which the density is computed; it is interpolated between them."""


def select_by_divergence(problem: Problem) -> Registration:
    """Select the sample of the key clusters for which the densities of the two scans differ least.

    Every sample is a candidate; the best sample of each key cluster is reported, with the score ``exp(-D)`` for the
    divergence D. The covariance is the scatter of the result's clusters, as the method has no better estimate.
    """
    p, reference, current = problem.parameters, problem.reference, problem.current
    rotations = problem.rotations
    translations = problem.translations(rotations)
    labels = translations.labels
    key = np.flatnonzero((labels >= 0) & (labels < KEY_CLUSTERS))
    if not len(key):
        return failed('no two pairs of lines cross')
    candidates = np.column_stack((translations.samples[key], rotations.phi[translations.rotation[key]]))
    divergence = divergences(candidates, reference.points, current.points, p.divergence)
    order = np.argsort(divergence, kind='stable')
    leaders = order[np.sort(np.unique(labels[key[order]], return_index=True)[1])]
    hypotheses = tuple(Hypothesis(SE2.from_array(candidates[i]), math.exp(-divergence[i])) for i in leaders)
    winner = hypotheses[0]
    best = problem.fit(candidates[leaders[:1]], current.sampled_points)
    _, overlap, _ = score(best, reference, current, p.refinement.score_scale, p.density)
    covariance = _scatter(winner.transform, int(key[leaders[0]]), rotations, translations)
    matches = partial(match_segments, reference.segments, current.segments, winner.transform)
    return Registration(winner.transform, covariance, Status.OK, overlap=float(overlap[0]), score=winner.score,
                        hypotheses=hypotheses, find_matches=matches)


def _scatter(transform: SE2, sample: int, rotations: Rotations, translations: Translations) -> FloatArray:
    """Return the covariance ``(3, 3)`` in the current sensor's frame: mean squared deviations of cluster samples."""
    cluster = translations.samples[translations.labels == translations.labels[sample]]
    off = SE2(0.0, 0.0, -transform.theta).apply(cluster - (transform.x, transform.y))
    rotation = rotations.difference[rotations.labels == translations.rotation[sample]] - transform.theta
    covariance = RESOLUTION ** 2 * np.eye(DOF)  # the scatter of a cluster of one sample is 0
    covariance[:2, :2] += off.T @ off / len(off)
    covariance[2, 2] += np.mean(wrap_period(rotation, math.pi) ** 2)
    return covariance


def divergences(candidates: FloatArray, reference: FloatArray, current: FloatArray,
                parameters: DivergenceParameters) -> FloatArray:
    """Return the symmetric K-L divergence of the scans' densities for every candidate, the sum over x and y.

    Parameters
    ----------
    candidates : (C, 3) array
        x, y [m] and theta [rad].
    reference, current : (P, 2), (Q, 2) arrays
        Points [m].
    parameters : DivergenceParameters

    Returns
    -------
    (C,) array
    """
    total = np.zeros(len(candidates))
    bandwidths = [parameters.bandwidth or silverman(column) for column in reference.T]
    for theta in np.unique(candidates[:, 2]):
        at = np.flatnonzero(candidates[:, 2] == theta)
        rotated = SE2(0.0, 0.0, theta).apply(current)
        for axis, bandwidth in enumerate(bandwidths):
            total[at] += shifted_divergences(reference[:, axis], rotated[:, axis], candidates[at, axis], bandwidth,
                                             parameters)
    return total


def shifted_divergences(reference: FloatArray, current: FloatArray, shifts: FloatArray, bandwidth: float,
                        parameters: DivergenceParameters) -> FloatArray:
    """Return the symmetric K-L divergence (Eq. 19-21) of two sets of numbers for `shifts` of the second.

    The sums of Eq. 19-20 run over `divergence.grid` places that cover both sets, times the step between them, and
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
    grid = np.linspace(low, high, parameters.grid)
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
    """Return the bandwidth [m] of Silverman's rule of thumb for normal samples, ``s (4 / 3n)^(1/5)``, at least 1 mm."""
    return float(max(float(np.std(samples, ddof=1)) * (0.75 * len(samples)) ** -0.2, RESOLUTION))
