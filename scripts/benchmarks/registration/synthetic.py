# SPDX-License-Identifier: Apache-2.0
"""Real scans with noise and outliers, moved by a known motion (section 3 of the paper, and harder).

The motion is known exactly, so that what is missed is missed because of noise and outliers alone.
"""
import math

import numpy as np

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.paper.pipeline import PAPER_MOTION
from dbscan_reg_ros.core.scan import Scan

from ..intel import Intel
from ..report import at_least
from ..trials import Trial, rates, thinned

SCANS = 200
MIN_RETURNS = 150
NOISE = 0.01
OUTLIER_SHARES = (0.0, 0.1, 0.3)

BOUNDS = {
    'random_0': at_least(0.995), 'random_10': at_least(0.995), 'random_30': at_least(0.995),
    'paper_0': at_least(0.995), 'paper_10': at_least(0.995), 'paper_30': at_least(0.995),
    'any_0': at_least(0.995), 'any_10': at_least(0.99), 'any_30': at_least(0.99),
    'ok_precision': at_least(0.997), 'ok_recall': at_least(0.96),
}


def disturbed(scan, noise, outlier_share, rng):
    """``(N,)`` ranges [m] of `scan` with N(0, `noise`) added and a fraction of the beams replaced.

    The replaced beams return U(0.2 m, min(10 m, the longest return)); `inf` marks beams with no return.
    """
    ranges = np.where(scan.valid, scan.ranges.astype(float), np.inf)
    longest = ranges[scan.valid].max()
    ranges += rng.normal(0.0, noise, len(ranges))
    beams = rng.permutation(len(ranges))[:round(outlier_share * len(ranges))]
    ranges[beams] = rng.uniform(0.2, min(10.0, longest), len(beams))
    return np.where(ranges > 0.0, ranges, np.inf)


def moved(scan, ranges, motion) -> Scan:
    """Return the returns at `ranges` along the beams of `scan`, seen after `motion`: it maps the new scan to `scan`.

    The beams keep their order and get one bearing each.
    """
    points = np.where(np.isfinite(ranges), ranges, np.nan)[:, None] * scan.geometry.directions
    return Scan.from_points(motion.inverse().apply(points), stamp=scan.stamp,
                            angle_increment=scan.geometry.angle_increment)


def random_motion(rng, translation, rotation) -> SE2:
    """x, y within +- `translation` [m], theta within +- `rotation` [rad]."""
    return SE2(*rng.uniform(-translation, translation, 2), rng.uniform(-rotation, rotation))


def chosen(scans, rng) -> list:
    """Return indices of 200 scans with more than 150 returns."""
    rich = [i for i, scan in enumerate(scans) if np.count_nonzero(scan.valid) > MIN_RETURNS]
    return sorted(rng.choice(rich, min(SCANS, len(rich)), replace=False).tolist())


def trials(intel, limit=None, seed=0) -> list:
    """Return a `Trial` for each chosen scan, kind of motion and fraction of outliers.

    `limit` counts for each combination.
    """
    rng = np.random.default_rng(seed)
    indices = chosen(intel.scans, rng)
    motions = {
        'random': [random_motion(rng, 1.5, 0.5) for _ in indices],
        'paper': [PAPER_MOTION for _ in indices],
        'any': [random_motion(rng, 2.5, math.pi) for _ in indices],
    }
    items = []
    for kind, truths in motions.items():
        for share in OUTLIER_SHARES:
            group = f'{kind}_{round(100 * share)}'
            made = [Trial(group, str(i), intel.scans[i],
                          moved(intel.scans[i], disturbed(intel.scans[i], NOISE, share, rng), truth), truth)
                    for i, truth in zip(indices, truths, strict=True)]
            items += thinned(made, limit)
    return items


def measure(args):
    """Return a `Report`."""
    return rates(args, trials(Intel.below(args.data), args.limit), BOUNDS)
