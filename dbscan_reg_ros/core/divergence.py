"""Selection within the key clusters: kernel densities of x and y, K-L divergence (section 2.3, Eq. 16-21)."""
import math

import numpy as np
from scipy.special import logsumexp

from .parameters import DivergenceParameters, Parameters
from .records import Features, Hypothesis, Registration, Status
from .rotation import Rotations
from .se2 import SE2
from .translation import Translations

_NODES = 8


def select_by_divergence(reference: Features, current: Features, rotations: Rotations, translations: Translations,
                         parameters: Parameters) -> Registration:
    """The sample of the key clusters that makes the two scans' densities most alike.

    Every sample is a hypothesis; the best of each key cluster is reported, its score ``exp(-D)``. The covariance is
    the scatter of the winner's cluster and of the rotation's.
    """
    labels = translations.labels
    key = np.flatnonzero((labels >= 0) & (labels < parameters.translation.key_clusters))
    if not len(key):
        return Registration(SE2(), np.eye(3), Status.FAILED, reason='no two pairs of lines cross')
    candidates = np.column_stack((translations.samples[key], translations.transform[labels[key], 2]))
    divergence = divergences(candidates, reference.points, current.points, parameters.divergence)
    order = np.argsort(divergence, kind='stable')
    best = order[np.sort(np.unique(labels[key[order]], return_index=True)[1])]
    hypotheses = tuple(Hypothesis(SE2.from_array(candidates[i]), math.exp(-divergence[i])) for i in best)
    winner = hypotheses[0]
    covariance = _scatter(winner.transform, labels[key[best[0]]], rotations, translations, key[best[0]])
    return Registration(winner.transform, covariance, Status.OK, score=winner.score, hypotheses=hypotheses)


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
    """Silverman's rule of thumb for the bandwidth: ``0.9 min(s, IQR / 1.349) n^(-1/5)``, at least 1 mm."""
    quarter = np.percentile(samples, (25.0, 75.0))
    spread = min(float(np.std(samples, ddof=1)), float(quarter[1] - quarter[0]) / 1.349)
    return max(0.9 * spread * len(samples) ** -0.2, 1e-3)


def _scatter(transform, cluster, rotations, translations, sample):
    """Covariance (3, 3) in the current sensor's frame, from the samples around the winner."""
    off = translations.samples[translations.labels == cluster] - (transform.x, transform.y)
    body = SE2(0.0, 0.0, -transform.theta).apply(off)
    period = math.pi
    turn = rotations.difference[rotations.labels == translations.rotation[sample]] - transform.theta
    turn = (turn + 0.5 * period) % period - 0.5 * period
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = body.T @ body / len(body)
    covariance[2, 2] = np.mean(turn ** 2)
    return covariance + 1e-6 * np.eye(3)
