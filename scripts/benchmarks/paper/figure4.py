# SPDX-License-Identifier: Apache-2.0
"""Figure 4 of the paper: real scans and the same points moved, recovered to 1 mm and 0.001 rad.

The paper shows one such scan. A method that has all points and no noise has no reason to miss one of them, so the bound
is all of the 50 scans on which the open values of the paper's method were chosen.
"""
import numpy as np

from dbscan_reg_ros.core.paper.pipeline import PAPER_MOTION, moved

from ..intel import Intel
from ..registration.synthetic import MIN_RETURNS
from ..report import at_least
from ..trials import Trial, failures, run, summarise, thinned

SCANS = (
    13, 26, 41, 82, 110, 141, 167, 203, 398, 445, 546, 722, 971, 977, 1389, 1440, 1482, 1598, 1629, 2152, 2228,
    2325, 2617, 2717, 2749, 2844, 2917, 2918, 2977, 3000, 3230, 3295, 3359, 3373, 3441, 3454, 3587, 3602, 3944,
    3955, 4130, 4432, 4535, 4714, 4719, 4769, 4805, 5032, 5151, 5324,
)
"""Which scans of the Intel log: 50 drawn by `draw`. The open values of the paper's method were chosen on them."""
EXAMPLE = 2152
"""The one of them that is shown step by step: the paper's method solves it."""
OTHERS = 200
"""Number of further scans, on which no parameter was chosen."""
TRANSLATION_LIMIT = 0.001
ROTATION_LIMIT = 0.001
BOUNDS = {'chosen_exact': at_least(1.0)}


def draw(scans, count=len(SCANS), seed=0, without=()) -> list:
    """Draw the indices of `count` scans with more than 150 returns at random."""
    rich = [i for i, scan in enumerate(scans) if np.count_nonzero(scan.valid) > MIN_RETURNS and i not in without]
    return sorted(np.random.default_rng(seed).choice(rich, count, replace=False).tolist())


def draw_others(scans) -> list:
    """Draw the indices of 200 scans that are not among the 50."""
    return draw(scans, OTHERS, 1, frozenset(SCANS))


def trial(scan, label='', group='figure4') -> Trial:
    """Make a trial: the current scan is `scan`, the reference its points moved by (-1.5, 0.8, 0.3)."""
    return Trial(group, label, moved(scan), scan, PAPER_MOTION)


def exact(outcome) -> bool:
    """Within 1 mm and 0.001 rad of the truth."""
    return outcome.translation_error <= TRANSLATION_LIMIT and outcome.rotation_error <= ROTATION_LIMIT


def add(report, methods, args):
    """Add a table to a `Report`: the fraction of exact results for the 50 scans and for others, and the usual rates."""
    scans = Intel.below(args.data).scans
    groups = {'chosen': SCANS, 'others': draw_others(scans)}
    trials = [trial(scans[i], str(i), group) for group, indices in groups.items() for i in thinned(indices, args.limit)]
    rows = {}
    for name, outcomes in run(methods, trials, 'figure 4').items():
        shares = {f'{group}_exact': float(np.mean([exact(o) for o in outcomes if o.trial.group == group]))
                  for group in groups}
        rows[name] = shares | summarise(outcomes)
        if args.verbose:
            print(f'{name}\n{failures(outcomes)}\n')
    report.add('figure 4', rows, BOUNDS, prefix='figure4_')
