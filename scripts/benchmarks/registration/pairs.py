# SPDX-License-Identifier: Apache-2.0
"""Pairs k, k+s of the Intel log without an initial guess.

A registration without a guess restarts a lost odometry and closes loops. Between the scans of a drive it has to be
right nearly always, over 20 scans as often as the views overlap enough, and what it calls OK has to be right.
"""
from ..intel import Intel
from ..report import at_least, at_most
from ..trials import Trial, rates, thinned

BOUNDS = {
    'pairs_s1': at_least(0.995), 'pairs_s2': at_least(0.995), 'pairs_s5': at_least(0.995),
    'pairs_s10': at_least(0.99), 'pairs_s20': at_least(0.97),
    'median_m': at_most(0.003), 'median_deg': at_most(0.1),
    'ok_precision': at_least(0.997), 'ok_recall': at_least(0.96),
}


def trials(intel, limit=None) -> list:
    """Return a `Trial` for each pair; `limit` counts for each s."""
    groups = {}
    for i, j, truth in intel.pairs:
        groups.setdefault(j - i, []).append(
            Trial(f'pairs_s{j - i}', f'{i} {j}', intel.scans[i], intel.scans[j], truth))
    return [trial for step in sorted(groups) for trial in thinned(groups[step], limit)]


def measure(args):
    """Return a `Report`."""
    return rates(args, trials(Intel.below(args.data), args.limit), BOUNDS)
