# SPDX-License-Identifier: Apache-2.0
"""Which lidars are named: both of two that disagree, of more the odd one."""
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...geometry.array_types import FloatArray
from ...geometry.se2 import DOF, SE2, lever_arm
from ...geometry.ties import first_largest
from .compared_lidar import ComparedLidar
from .relative_pose import Disagreement, RelativePose, difference


class Named(NamedTuple):
    """A lidar that disagrees with others.

    Attributes
    ----------
    others : str
        With which.
    estimate : RelativePose
        Its mounting and time offset if the others are right.
    error : Disagreement
        By how much the given values differ from it.
    """

    others: str
    estimate: RelativePose
    error: Disagreement

    def __str__(self) -> str:
        return f'disagrees with {self.others}: {self.error}'


def named(first: SE2, others: Sequence[ComparedLidar | None]) -> list[Named | None]:
    """Return an entry for each lidar, the first one first; None for those that are not named.

    Parameters
    ----------
    first : SE2
        Mounting of the first lidar in the followed frame, as given.
    others : sequence of ComparedLidar or None
        All other lidars; None for those that have not been compared.
    """
    odd: list[ComparedLidar | None] = [each if each and each.disagrees and not each.unfit else None for each in others]
    found = [each for each in odd if each]
    if len(found) == len(others) == 1:
        return [_of_first(first, found, 'the other lidar, and one of both is wrong'),
                Named('the first lidar, and one of both is wrong', found[0].estimate, found[0].error)]
    if found and len(found) == len(others):
        of_first = _of_first(first, found, 'all others, which agree with each other')
        if of_first:
            return [of_first, *([None] * len(others))]
    return [None, *(Named('the first lidar', each.estimate, each.error) if each else None for each in odd)]


def _of_first(given: SE2, others: Sequence[ComparedLidar], against: str) -> Named | None:
    """Return what is wrong with the first lidar if all `others` are right; None if they disagree with it differently.

    If it is wrong, the mountings of all others seem to be moved by the same motion of the followed frame, and their
    stamps by the same time.
    """
    best = others[int(first_largest(-np.array([each.estimate.sigmas[2] for each in others])))]
    motion = best.estimate.pose @ best.given.inverse()
    for other in others:
        expected = motion @ other.given
        covariance = other.estimate.covariance + _at(best.estimate, expected)
        if any(difference(expected, other.estimate._replace(covariance=covariance), best.estimate.time_offset)):
            return None
    pose = motion.inverse() @ given
    estimate = RelativePose(pose, -best.estimate.time_offset, _at(best.estimate, pose))
    return Named(against, estimate, difference(given, estimate))


def _at(best: RelativePose, pose: SE2) -> FloatArray:
    """Return the covariance ``(4, 4)`` of a `pose` that is rigidly connected to the `best` one, and of its time."""
    jacobian = np.eye(len(best.covariance))
    jacobian[:DOF, :DOF] = lever_arm(pose.x - best.pose.x, pose.y - best.pose.y)
    covariance: FloatArray = jacobian @ best.covariance @ jacobian.T
    return covariance


UNFIT = ('is not used, as its scans do not fit the map of the first lidar: check the transforms of both, also roll and '
         'the sign of yaw, and whether each has a frame of its own')
"""What is wrong with a lidar that is `unfit <ComparedLidar.unfit>`."""
