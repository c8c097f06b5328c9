# SPDX-License-Identifier: Apache-2.0
"""Which lidars are wrong: the first one, if all others agree with each other, or the only other with the wheels."""
from collections import deque
from collections.abc import Collection, Sequence

import numpy as np

from ...geometry.array_types import FloatArray
from ...geometry.se2 import SE2
from ...geometry.ties import first_largest
from .compared_lidar import PROBABLE, ComparedLidar, difference
from .relative_pose import RelativePose
from .wheels import Wrong


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
    others = {Wrong.UNKNOWN: 'all others, which agree with each other' if is_first else 'the first lidar',
              Wrong.FIRST: 'the other lidar, which agrees with the wheels' if is_first else 'the first lidar',
              Wrong.FURTHER: 'the first lidar, which agrees with the wheels'}
    return f'disagrees with {others[compared.wrong]}: {compared.error}'


def error_of_first(given: SE2, others: Collection[ComparedLidar]) -> ComparedLidar | None:
    """Return error and estimated mounting of the first lidar if it is the one that is wrong; else None.

    If it is, the mountings of all others seem to be moved by the same motion of the followed frame, and their stamps by
    the same time. Of a single other lidar the wheels show which of both is wrong.

    Parameters
    ----------
    given : SE2
        Mounting of the first lidar in the followed frame, as given.
    others : collection of ComparedLidar
        All other lidars.
    """
    found = [(each.given, each.estimate) for each in others if each.error is not None and each.estimate is not None]
    by_wheels = [each.wrong for each in others] == [Wrong.FIRST]
    if len(found) < max(len(others), 1 if by_wheels else _LEAST):
        return None
    best_given, best = found[first_largest(-np.array([each.sigmas[2] for _, each in found]))]
    motion = best.pose @ best_given.inverse()
    for other, estimate in found:
        expected = motion @ other
        covariance = estimate.covariance + _at(best, expected)
        if any(difference(expected, best.time_offset, estimate._replace(covariance=covariance), PROBABLE)):
            return None
    pose = motion.inverse() @ given
    estimate = RelativePose(pose, -best.time_offset, _at(best, pose))
    error = difference(given, 0.0, estimate, PROBABLE)
    return ComparedLidar(given, deque(), estimate=estimate, error=error,
                         wrong=Wrong.FIRST if by_wheels else Wrong.UNKNOWN) if any(error) else None


def _at(best: RelativePose, pose: SE2) -> FloatArray:
    """Return the covariance ``(4, 4)`` of a `pose` that is rigidly connected to the `best` one, and of its time."""
    jacobian = np.eye(len(best.covariance))
    jacobian[:2, 2] = best.pose.y - pose.y, pose.x - best.pose.x
    covariance: FloatArray = jacobian @ best.covariance @ jacobian.T
    return covariance


UNFIT = ('is not used, as its scans do not fit the map of the first lidar: check the transforms of both, also roll and '
         'the sign of yaw, and whether each has a frame of its own')
"""What is wrong with a lidar that is `unfit <ComparedLidar.unfit>`."""
_LEAST = 2
"""Number of other lidars that have to agree with each other."""
