# SPDX-License-Identifier: Apache-2.0
"""Evidence for poses in a map: what should be seen and is, and what should be seen and is not.

Each square of a drive counts once, however many scans saw it. A hypothesis is right, or a place that suits the drive by
chance. Of the returns of a drive, a share lies on the surfaces of the map at its pose. This share is not known, but
distributed: narrowly at the right pose, less narrowly at the right pose in a part of the building that has changed
since, and broadly where the pose is wrong. A corridor suits many corridors, so that the share at wrong poses is high at
some places and low at others: it is one unknown of the drive, and the best of the other poses in the map show it. What
suits two poses well suits a place outside the map as well, unless it suits both so well that one is a copy of the
other. Between a place and its copy a few returns do not decide: of the copy, too, some are not as they were mapped.

The constants of changes and of wrong poses maximise the mean log-probability of the truth on one simulated floor, with
lidars of 180 and 360 deg, for drives on it as mapped and changed, and for drives on another floor. The others were set
by hand: no return alone may tell two equal places apart, and maps differ in what they leave out. On a second floor and
on recordings, hypotheses with a probability of 0.95 and more were right.
"""
import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln, logsumexp, xlogy

INDEPENDENT = 2.0
"""Number of returns, a tenth of a metre apart, that are as good as one that depends on no other."""
RIGHT = 0.99, 75.0
"""Mean of the share of returns on surfaces at the right pose, and the strength of this mean, in independent returns."""
CHANGED = 0.93, 50.0
"""The same where the building has changed since it was mapped."""
HAS_CHANGED = 0.03
"""Probability that it has."""
WRONG = 0.68, 9.0
"""Mean and strength of the share at the best wrong poses."""
HOW_KNOWN, HOW_UNKNOWN = (0.15, 5.0), (0.4, 3.0)
"""Mean of the share of returns into the unknown, and its strength, at the right pose and at the best wrong ones."""
COPIED = 0.005
"""Probability that another place in the map is a copy of the right one."""
FOUND = 0.97
"""Probability that the right pose is among the candidates of a scan."""
ALIKE = 0.1
"""Probability that a place that was not found suits the drive as well as the best one that was."""
INSIDE = 0.5
"""Probability that the sensor is in the map, before anything was seen."""
SHARES = 1.0 / (1.0 + np.exp(-np.arange(-4.0, 7.5, 0.5)))
"""Shares (S,) at the best wrong poses of a drive over which is summed, evenly spaced in their log-odds."""
PRIOR = xlogy(WRONG[0] * WRONG[1], SHARES) + xlogy((1.0 - WRONG[0]) * WRONG[1], 1.0 - SHARES)
"""Logarithm of the probability (S,) of each, up to a constant."""
PRIOR -= logsumexp(PRIOR)


def log_odds(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the log-odds (H,) of each of different hypotheses against none of them.

    Parameters
    ----------
    counts : (H, 6) float
        Those of `Matcher.count`.
    """
    right, wrong = _likelihoods(counts)
    first, *others = np.argsort(logsumexp(PRIOR + wrong, axis=1) - right, kind='stable')[:2]
    # A place that is not the right one: wrong, or a copy of it.
    other = np.logaddexp(np.log(1.0 - COPIED) + wrong, np.log(COPIED) + right[:, None])
    none = logsumexp(PRIOR + wrong[first] + wrong[others].sum(axis=0))
    # Of the best and each other place one is right, and the other one is not.
    against = right - logsumexp(PRIOR + other, axis=1)
    found: NDArray[np.float64] = (against - against[first] + right[first]
                                  + logsumexp(PRIOR + other[others].sum(axis=0)) - none)
    return found


def log_odds_alone(counts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the log-odds (H,) of each hypothesis against a wrong pose; the parameter is that of `log_odds`."""
    right, wrong = _likelihoods(counts)
    found: NDArray[np.float64] = right - logsumexp(PRIOR + wrong, axis=1)
    return found


def _likelihoods(counts):
    """Return the log-likelihoods at the right pose (H,), and at a wrong one for each of the `SHARES` (H, S)."""
    on, off, unknown, _, blocked, _ = counts.T / INDEPENDENT
    known = on + off + blocked
    right = (np.logaddexp(np.log(1.0 - HAS_CHANGED) + _chance(on, known, *RIGHT),
                          np.log(HAS_CHANGED) + _chance(on, known, *CHANGED))
             + _chance(unknown, known + unknown, *HOW_KNOWN) - _chance(unknown, known + unknown, *HOW_UNKNOWN))
    return right, on[:, None] * np.log(SHARES) + (known - on)[:, None] * np.log(1.0 - SHARES)


def _chance(count, total, mean, strength):
    """Return the logarithm of the chance of such a sequence, if its share has a beta distribution (beta-binomial)."""
    a, b = mean * strength, (1.0 - mean) * strength
    return betaln(count + a, total - count + b) - betaln(a, b)


def probabilities(odds: NDArray[np.float64], scans: int) -> tuple[NDArray[np.float64], float, float]:
    """Return the probabilities of hypotheses with these log-odds (H,), and those of what they leave out.

    The right place is elsewhere in the map if it was among the candidates of none of the `scans`; or it is outside.

    Returns
    -------
    inside : (H,) float
    missed, outside : float
    """
    likelihood = np.exp(np.clip(odds, -50.0, 50.0))
    unfound = (1.0 - FOUND) ** scans
    weight = INSIDE * (1.0 - unfound) * likelihood
    # A place that was not found yet may suit the drive as well as the best.
    missed = INSIDE * unfound * (1.0 + ALIKE * likelihood.max())
    total = weight.sum() + missed + 1.0 - INSIDE
    return weight / total, missed / total, (1.0 - INSIDE) / total
