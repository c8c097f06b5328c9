# SPDX-License-Identifier: Apache-2.0
"""Your own method in `compare`: python 05_own_method_for_compare.py [RECORDING with truth or relations]."""
import sys
from pathlib import Path

from scipy.spatial import cKDTree

from dbscan_reg_ros import SE2, Scan
from dbscan_reg_ros.commands import compare, simulate
from dbscan_reg_ros.evaluation.baselines import fit

NEAREST = 0.5  # points that are farther apart [m] do not correspond


def align(reference: Scan, current: Scan, guess: SE2) -> SE2:
    """Return the pose of the `Scan` `current` in the frame of the `Scan` `reference`: point-to-point ICP."""
    fixed, moving = (scan.points[scan.valid] for scan in (reference, current))
    transform, tree = SE2(guess.x, guess.y, guess.theta), cKDTree(fixed)
    for _ in range(20):
        distance, nearest = tree.query(transform.apply(moving))
        transform = fit(fixed[nearest[distance < NEAREST]], moving[distance < NEAREST])
    return transform


if __name__ == '__main__':  # dbscan-reg-ros compare defaults 05_own_method_for_compare:align RECORDING
    if not sys.argv[1:]:
        simulate.main(['hall.log', '--world', 'hall', '--speed', '2', '--rate', '4'])
    compare.main(['defaults', f'{Path(__file__).stem}:align', *(sys.argv[1:] or ['hall.log'])])
