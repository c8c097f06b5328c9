# SPDX-License-Identifier: Apache-2.0
"""Which lidars are wrong: the first of three or more, if all others agree with each other, but not with it."""
from collections import deque
from collections.abc import Collection, Sequence

import numpy as np

from ...geometry.array_types import FloatArray
from ...geometry.se2 import SE2
from .compared_lidar import PROBABLE, ComparedLidar, difference
from .relative_pose import RelativePose


def disagreeing(given: SE2, others: Sequence[ComparedLidar | None]) -> list[ComparedLidar | None]:
    """Return error and estimated mounting of each lidar, the first one first; None for those that do not disagree.

    Parameters
    ----------
    given : SE2
        Mounting of the first lidar in the followed frame, as given.
    others : sequence of ComparedLidar or None
        All other lidars; None for those that have not been compared.
    """
    compared = [each for each in others if each is not None]
    if len(compared) == len(others) and (first := error_of_first(given, compared)):
        return [first, *(None for _ in others)]
    return [None, *(each if each and each.error is not None else None for each in others)]


def described(compared: ComparedLidar, is_first: bool) -> str:
    """Return with which lidars one of the `disagreeing` lidars disagrees, and by how much."""
    others = 'all others, which agree with each other' if is_first else 'the first lidar'
    return f'disagrees with {others}: {compared.error}'


def error_of_first(given: SE2, others: Collection[ComparedLidar]) -> ComparedLidar | None:
    """Return error and estimated mounting of the first lidar if it is the one that is wrong; else None.

    If it is, the mountings of all others seem to be moved by the same motion of the followed frame, and their stamps by
    the same time. A single other lidar does not show which of both is wrong.

    Parameters
    ----------
    given : SE2
        Mounting of the first lidar in the followed frame, as given.
    others : collection of ComparedLidar
        All other lidars.
    """
    found = [(each.given, each.estimate) for each in others if each.error is not None and each.estimate is not None]
    if len(found) < max(len(others), _LEAST):
        return None
    best_given, best = min(found, key=lambda each: float(each[1].sigmas[2]))
    motion = best.pose @ best_given.inverse()
    for other, estimate in found:
        expected = motion @ other
        covariance = estimate.covariance + _at(best, expected)
        if any(difference(expected, best.time_offset, estimate._replace(covariance=covariance), PROBABLE)):
            return None
    pose = motion.inverse() @ given
    estimate = RelativePose(pose, -best.time_offset, _at(best, pose))
    return ComparedLidar(given, deque(), estimate=estimate, error=difference(given, 0.0, estimate, PROBABLE))


def _at(best: RelativePose, pose: SE2) -> FloatArray:
    """Return the covariance ``(4, 4)`` of a `pose` that is rigidly connected to the `best` one, and of its time."""
    jacobian = np.eye(len(best.covariance))
    jacobian[:2, 2] = best.pose.y - pose.y, pose.x - best.pose.x
    covariance: FloatArray = jacobian @ best.covariance @ jacobian.T
    return covariance


_LEAST = 2
"""Number of other lidars that have to agree with each other."""
