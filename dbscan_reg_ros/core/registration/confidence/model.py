# SPDX-License-Identifier: Apache-2.0
"""Statistical model of the confidence: a logistic regression over the evidence, and the share among rivals.

``scripts/bench confidence --fit`` fits the coefficients to simulated pairs of all lidars and to some of the Intel log.
"""
import math
from collections.abc import Sequence

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
"""Coefficient of each of the `evidence_terms`, as ``scripts/bench confidence --fit`` prints them."""

PLACE_INTERCEPT = -6.137
PLACE_COEFFICIENTS = {
    'conflicts': -18.247,
    'on outline': 0.412,
    'matched ends': 1.657,
    'unmatched ends': 0.629,
    'crossing': -0.041,
    'residual': -30.205,
    'distance': 0.332,
    'weak': 7.019,
    'prior': 1.039,
}
"""The same for the first scan after a gap, which may be from another place; `prior` is what the prior adds."""


def confidence(odds: float, rivals: Sequence[float] = ()) -> float:
    """Return the probability, 0..1, that a motion with these log-odds is right, beside `rivals` with theirs.

    It is the probability that one of them is right, times the ratio of the odds of this one to those of all.
    """
    return probability(odds) / (1.0 + sum(math.exp(min(each - odds, _MAX_LOG_ODDS)) for each in rivals))


def probability(odds: float) -> float:
    """Return the probability, 0..1, that belongs to log-odds."""
    return 1.0 / (1.0 + math.exp(-min(max(odds, -_MAX_LOG_ODDS), _MAX_LOG_ODDS)))


LIKELY = 0.5
"""Confidence from which on a result is more likely right than wrong."""
_MAX_LOG_ODDS = 50.0
ANY_MOTION = 250.0
"""Volume [m^2 rad] of the region of uniformly drawn motions between the pairs of scans that the model was fitted to."""
WRONG_PRIORS = 0.1
"""Probability that a motion does not follow its prior."""
