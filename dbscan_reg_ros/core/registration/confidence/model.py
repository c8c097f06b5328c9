# SPDX-License-Identifier: Apache-2.0
"""Statistical model of the confidence: a logistic regression over the evidence, and the share among rivals.

``scripts/bench confidence --fit`` fits the coefficients to simulated pairs of all lidars and to some of the Intel log.
"""
import math
from collections.abc import Callable

import numpy as np

from ...geometry.array_types import FloatArray
from ...geometry.tolerance import SAME
from ..records import Evidence, Prior
from ..scoring import squared_mahalanobis

TERMS: dict[str, Callable[[Evidence], float]] = {
    'residual': lambda e: e.residual,
    'weak': lambda e: math.log1p(max(e.weak, 0.0)),
    'rotation': lambda e: math.log1p(max(e.rotation, 0.0)),
    'conflicts of the current scan': lambda e: math.sqrt(e.current.conflicts),
    'conflicts of the reference': lambda e: math.sqrt(e.reference.conflicts),
    'points on the outline': lambda e: math.log1p(e.current.on_outline),
    'matched ends': lambda e: math.log1p(e.matched_ends),
    'crossing': lambda e: math.log(SAME + max(e.crossing, 0.0)),
    'distance': lambda e: e.distance,
    'angle': lambda e: e.angle,
}
"""Terms of the log-odds: name -> function of the evidence."""
INTERCEPT = 2.157
COEFFICIENTS = {
    'residual': -48.932,
    'weak': 0.897,
    'rotation': 0.571,
    'conflicts of the current scan': -10.647,
    'conflicts of the reference': -9.110,
    'points on the outline': -0.561,
    'matched ends': 1.722,
    'crossing': 0.580,
    'distance': -0.326,
    'angle': -0.461,
}
"""Coefficient of each of the `TERMS`, as ``scripts/bench confidence --fit`` prints them."""


def confidence(evidence: Evidence, prior: Prior | None = None, candidate: FloatArray | None = None) -> float:
    """Return the probability, 0..1, that the motion `candidate` ``(3,)`` with this `evidence` is right.

    It is that of the logistic regression, with the gain by a `prior`, times the share among the rivals.
    """
    odds = log_odds(evidence)
    if prior is not None and candidate is not None:
        odds += prior_gain(prior, candidate)
    return float(_logistic(odds) * share_of_best(evidence.margin))


def log_odds(evidence: Evidence) -> float:
    """Return the logarithm of the odds that a motion is right, by its evidence alone."""
    return INTERCEPT + sum(coefficient * TERMS[name](evidence) for name, coefficient in COEFFICIENTS.items())


def share_of_best(margin: float) -> float:
    """Return the probability, 0..1, that of two motions the one that scores more by a `margin` is the right one."""
    return _logistic(margin / SCORE_SCALE)


def prior_gain(prior: Prior, candidate: FloatArray) -> float:
    """Return what a prior adds to the log-odds of a motion (Bayes' rule).

    It is the logarithm of the density at the motion over that of the motions which the model was fitted to. The density
    is a normal distribution by the prior, or with some probability, as priors may be wrong, that of any motion.
    """
    squared = float(squared_mahalanobis(candidate[None], prior)[0])
    normaliser = math.sqrt((2.0 * math.pi) ** len(candidate) * float(np.linalg.det(prior.covariance)))
    return math.log((1.0 - _WRONG_PRIORS) * _ANY_MOTION / normaliser * math.exp(-0.5 * squared) + _WRONG_PRIORS)


def _logistic(odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-min(max(odds, -_MAX_LOG_ODDS), _MAX_LOG_ODDS)))


SCORE_SCALE = 0.012
"""Difference of two scores, as a log-odds of 1."""
_MAX_LOG_ODDS = 50.0
_ANY_MOTION = 250.0
"""Volume [m^2 rad] of the region in which the motions of the fitted pairs are uniformly distributed."""
_WRONG_PRIORS = 0.1
"""Probability that a motion does not follow its prior."""
