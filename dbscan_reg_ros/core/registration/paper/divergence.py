# SPDX-License-Identifier: Apache-2.0
"""Selection within the key clusters: kernel densities of x and y, K-L divergence (section 2.3, Eq. 16-21)."""
import math
from functools import partial

import numpy as np
from scipy.special import logsumexp

from ...features.records import Features
from ...geometry.se2 import SE2
from ...parameters.registration import DivergenceParameters
from ...parameters.tree import Parameters
from ..point_to_line import fit
from ..records import Hypothesis, Registration, Status
from ..rotation import Rotations, wrap_period
from ..scoring import score
from ..status import failed, match_segments
from ..translation import Translations

_NODES = 8
# Least variance [m^2, rad^2]: a cluster of one sample does not know how far off it is.
_LEAST_VARIANCE = 1e-6


def select_by_divergence(reference: Features, current: Features, rotations: Rotations, translations: Translations,
                         p: Parameters) -> Registration:
    """The sample of the key clusters that makes the two scans' densities most alike.

    Every sample is a candidate; the best of each key cluster is reported with the score ``exp(-D)``. The covariance is
    the scatter of the winner's cluster and of its rotation's: the method knows nothing better.
    """
    labels = translations.labels
    key = np.flatnonzero((labels >= 0) & (labels < p.translation.key_clusters))
    if not len(key):
        return failed('no two pairs of lines cross')
    candidates = np.column_stack((translations.samples[key], rotations.phi[translations.rotation[key]]))
    divergence = divergences(candidates, reference.points, current.points, p.divergence)
    order = np.argsort(divergence, kind='stable')
    leaders = order[np.sort(np.unique(labels[key[order]], return_index=True)[1])]
    hypotheses = tuple(Hypothesis(SE2.from_array(candidates[i]), math.exp(-divergence[i])) for i in leaders)
    winner = hypotheses[0]
    best = fit(candidates[leaders[:1]], current.sampled_points, reference.likelihood_field, p.density.min_normal_cosine)
    _, overlap = score(best, reference, current, p.refinement.score_scale, p.density)
    covariance = _scatter(winner.transform, key[leaders[0]], rotations, translations)
    matches = partial(match_segments, reference.segments, current.segments, winner.transform, p.decision)
    return Registration(winner.transform, covariance, Status.OK, float(overlap[0]), winner.score, hypotheses,
                        find_matches=matches)


def _scatter(transform, sample, rotations, translations):
    """Covariance (3, 3) in the current sensor's frame: mean squares of the clusters' samples about the winner."""
    cluster = translations.samples[translations.labels == translations.labels[sample]]
    off = SE2(0.0, 0.0, -transform.theta).apply(cluster - (transform.x, transform.y))
    turn = rotations.difference[rotations.labels == translations.rotation[sample]] - transform.theta
    covariance = _LEAST_VARIANCE * np.eye(3)
    covariance[:2, :2] += off.T @ off / len(off)
    covariance[2, 2] += np.mean(wrap_period(turn, math.pi) ** 2)
    return covariance


def divergences(candidates, reference, current, parameters: DivergenceParameters):
    """Symmetric K-L divergence of the scans' densities under every candidate, x and y added up.

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
        turned = SE2(0.0, 0.0, theta).apply(current)
        for axis, bandwidth in enumerate(bandwidths):
            total[at] += shifted_divergences(reference[:, axis], turned[:, axis], candidates[at, axis], bandwidth,
                                             parameters)
    return total


def shifted_divergences(reference, current, shifts, bandwidth, parameters: DivergenceParameters):
    """Symmetric K-L divergence (Eq. 19-21) of two sets of numbers, the second moved by every one of the `shifts`.

    The sums of Eq. 19-20 run over `grid` places that cover both sets, times the step between them: integrals in the
    limit. A shift moves the density with the numbers, so each density is estimated only once.

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
    margin = parameters.margin * bandwidth
    low = min(reference.min(), current.min() + shifts.min()) - margin
    high = max(reference.max(), current.max() + shifts.max()) + margin
    grid = np.linspace(low, high, parameters.grid)
    first, last = low - shifts.max(), high - shifts.min()
    nodes = np.linspace(first, last, max(int(_NODES * (last - first) / bandwidth), 2) + 1)
    log_p = CubicSpline(nodes, log_density(current, bandwidth, nodes))(grid - shifts[:, None])
    log_q = log_density(reference, bandwidth, grid)
    return ((np.exp(log_p) - np.exp(log_q)) * (log_p - log_q)).sum(axis=1) * (grid[1] - grid[0])


def log_density(samples, bandwidth, at):
    """Logarithm of the Gaussian kernel density estimate of `samples` ``(n,)`` at the places `at` (Eq. 16-18)."""
    exponent = -0.5 * ((at[:, None] - samples) / bandwidth) ** 2
    return logsumexp(exponent, axis=1) - math.log(len(samples) * bandwidth * math.sqrt(2.0 * math.pi))


def silverman(samples):
    """Silverman's rule of thumb for the bandwidth of normal samples, ``s (4 / 3n)^(1/5)``, at least 1 mm."""
    return max(float(np.std(samples, ddof=1)) * (0.75 * len(samples)) ** -0.2, 1e-3)
