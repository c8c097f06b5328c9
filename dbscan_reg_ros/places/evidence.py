# SPDX-License-Identifier: Apache-2.0
"""Evidence for poses in a map: what should be seen and is, and what should be seen and is not.

Each square of a drive counts once, however many scans saw it. A hypothesis is right, or a place that suits the drive by
chance. Of the returns of a drive, a share lies on the surfaces of the map at its pose. This share is not known, but
distributed: narrowly at the right pose, as little of a building changes after it was mapped, and broadly where the pose
is wrong. A corridor suits many corridors, so that the share at wrong poses is high at some places and low at others:
its mean is one unknown of the drive, about which the shares at the best wrong poses scatter a little. The best of the
other poses in the map show it: what suits several poses well suits a place outside the map as well, unless it suits
two so well that one is a copy of the other. Between a place and its copy a few returns do not decide: of the copy, too,
some are not as they were mapped.

The constants of shares maximise the mean log-probability of the truth, each drive counting as much as another, on two
simulated floors, as mapped and changed, with lidars of 180 and 360 deg, on recordings in one building, and outside:
on further floors, in another building, and where the map lacks the place. The others were set by hand: no return alone
may tell two equal places apart. On a third floor, where nothing was set, the mean log-probability was as good.
"""
import numpy as np
from numpy.typing import NDArray
from scipy.special import betaln, logsumexp, xlogy

INDEPENDENT = 2.0
"""Number of returns, a tenth of a metre apart, that are as good as one that depends on no other."""
RIGHT = 0.99, 35.0
"""Mean of the share of returns on surfaces at the right pose, and the strength of this mean, in independent returns."""
WRONG = 0.55, 10.6
"""Mean and strength of the mean share at the best wrong poses of a drive."""
SCATTER = 275.0
"""Strength of this mean: how alike the shares at the best wrong poses of one drive are."""
OTHERS = 3
"""Number of the best of the other places that show this mean."""
HOW_KNOWN, HOW_UNKNOWN = (0.05, 5.0), (0.35, 2.0)
"""Mean of the share of free squares that the map does not know, and its strength, at the right pose and at wrong ones:
a drive sees mostly what the drive of the map saw."""
COPIED = 0.005
"""Probability that another place in the map is a copy of the right one."""
FOUND = 0.97
"""Probability that the right pose is among the candidates of a scan."""
ALIKE = 0.1
"""Probability that a place that was not found suits the drive as well as the best one that was."""
INSIDE = 0.5
"""Probability that the sensor is in the map, before anything was seen."""
SHARES = 1.0 / (1.0 + np.exp(-np.arange(-4.0, 7.5, 0.5)))
"""Mean shares (S,) at the best wrong poses of a drive over which is summed, evenly spaced in their log-odds."""
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
    first, *others = np.argsort(logsumexp(PRIOR + wrong, axis=1) - right, kind='stable')[:1 + OTHERS]
    # A place that is not the right one: wrong, or the one that is a copy of it.
    copied = COPIED / max(len(counts) - 1, 1)
    other = np.logaddexp(np.log(1.0 - copied) + wrong, np.log(copied) + right[:, None])
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
    on, off, _, free, blocked, unknown = counts.T / INDEPENDENT
    known, squares = on + off + blocked, free + blocked + unknown
    right = (_chance(on, known, *RIGHT)
             + _chance(unknown, squares, *HOW_KNOWN) - _chance(unknown, squares, *HOW_UNKNOWN))
    return right, _chance(on[:, None], known[:, None], SHARES, SCATTER)


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
    inside = np.log(INSIDE * (1.0 - (1.0 - FOUND) ** scans)) + odds
    # A place that was not found yet may suit the drive as well as the best.
    missed = np.log(INSIDE) + scans * np.log(1.0 - FOUND) + np.logaddexp(0.0, np.log(ALIKE) + odds.max())
    weights = np.append(inside, (missed, np.log(1.0 - INSIDE)))
    *found, missed, outside = np.exp(weights - logsumexp(weights))
    return np.array(found), float(missed), float(outside)
