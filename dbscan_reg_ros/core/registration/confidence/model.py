# SPDX-License-Identifier: Apache-2.0
"""Statistical model of the confidence: a logistic regression over the evidence, and the share among rivals.

``scripts/bench confidence --fit`` fits the coefficients to simulated pairs of all lidars and to some of the Intel log.
"""
import math
from collections.abc import Callable, Sequence

from ...geometry.array_types import FloatArray
from ...geometry.se2 import SE2
from ...geometry.symmetric_matrix import determinant, mahalanobis
from ...geometry.tolerance import SAME
from ..records import Evidence, Prior


def excess(conflicts: float, chance: float) -> float:
    """Return how much the square root of a fraction of `conflicts` exceeds what `chance` explains."""
    return math.sqrt(conflicts + chance) - math.sqrt(chance)


TERMS: dict[str, Callable[[Evidence], float]] = {
    'conflicts': lambda e: excess(e.conflicts_current, e.chance) + excess(e.conflicts_reference, e.chance),
    'on outline': lambda e: math.log1p(e.on_outline),
    'matched ends': lambda e: math.log1p(e.matched_ends),
    'unmatched ends': lambda e: math.log1p(e.unmatched_ends),
    'crossing': lambda e: math.log(SAME + max(e.crossing, 0.0)),
    'residual': lambda e: e.residual,
    'distance': lambda e: e.distance,
    'weak': lambda e: max(e.weak, 0.0) / (2.0 + max(e.weak, 0.0)),
}
"""Terms of the log-odds: name -> function of the evidence."""
INTERCEPT = -1.773
COEFFICIENTS = {
    'conflicts': -11.503,
    'on outline': 0.730,
    'matched ends': 1.319,
    'unmatched ends': 1.213,
    'crossing': 0.509,
    'residual': -73.903,
    'distance': -0.264,
    'weak': 3.082,
}
"""Coefficient of each of the `TERMS`, as ``scripts/bench confidence --fit`` prints them."""


def log_odds(evidence: Evidence, prior: Prior | None = None, candidate: FloatArray | None = None) -> float:
    """Return the logarithm of the odds that the true motion is among the hypotheses, by the evidence of the best.

    With a `prior` its gain for the `candidate` ``(3,)`` is added.
    """
    odds = INTERCEPT + sum(coefficient * TERMS[name](evidence) for name, coefficient in COEFFICIENTS.items())
    return odds if prior is None or candidate is None else odds + prior_gain(prior, candidate)


def confidence(odds: float, rivals: Sequence[float] = ()) -> float:
    """Return the probability, 0..1, that a motion with these log-odds is right, beside `rivals` with theirs.

    It is the probability that one of them is right, times the ratio of the odds of this one to those of all.
    """
    return probability(odds) / (1.0 + sum(math.exp(min(each - odds, _MAX_LOG_ODDS)) for each in rivals))


def probability(odds: float) -> float:
    """Return the probability, 0..1, that belongs to log-odds."""
    return 1.0 / (1.0 + math.exp(-min(max(odds, -_MAX_LOG_ODDS), _MAX_LOG_ODDS)))


def prior_gain(prior: Prior, candidate: FloatArray) -> float:
    """Return what a prior adds to the log-odds of a motion (Bayes' rule).

    It is the logarithm of the density at the motion over that of the motions which the model was fitted to. The
    density is a mixture: the normal distribution of the prior and, with a small weight because a prior may be wrong,
    the density of any motion.
    """
    off = prior.transform.inverse() @ SE2.from_array(candidate.tolist())
    squared = mahalanobis(off.as_tuple(), prior.covariance)
    normaliser = math.sqrt((2.0 * math.pi) ** len(candidate) * determinant(prior.covariance))
    return math.log((1.0 - _WRONG_PRIORS) * _ANY_MOTION / normaliser * math.exp(-0.5 * squared) + _WRONG_PRIORS)


LIKELY = 0.5
"""Confidence from which on a result is more likely right than wrong."""
_MAX_LOG_ODDS = 50.0
_ANY_MOTION = 250.0
"""Volume [m^2 rad] of the region of uniformly drawn motions between the pairs of scans that the model was fitted to."""
_WRONG_PRIORS = 0.1
"""Probability that a motion does not follow its prior."""
