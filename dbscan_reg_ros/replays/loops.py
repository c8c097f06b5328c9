# SPDX-License-Identifier: Apache-2.0
"""Loop closing after a drive: correct the trajectory where the sensor returned to a place.

The odometry uses only its key-frame window, because its pose must not jump. A map that is drawn after the drive may be
corrected as a whole.
"""
from typing import NamedTuple

import numpy as np

from ..core.geometry.se2 import wrap
from ..places.key_frames import KeyFrames
from ..places.pose_graph import PoseGraph
from ..recordings.poses import compose, relative


class ClosedLoops(NamedTuple):
    """A drive after loop closing.

    Attributes
    ----------
    poses : (N, 3) float
        Corrected poses of the sensor; the first is unchanged.
    pairs : (L, 2) int
        Numbers of the two scans of each loop.
    graph : PoseGraph
        The key frames, in the frame of the odometry.
    """

    poses: np.ndarray
    pairs: np.ndarray
    graph: PoseGraph


class Loops(KeyFrames):
    """Collect the key frames of a drive; `close` corrects the poses."""

    def close(self, poses, parameters, yaw=0.0) -> ClosedLoops:
        """Correct the poses so that they agree with the odometry and all loops.

        Parameters
        ----------
        poses : (N, 3) array
            Poses of the sensor at every scan that was used [m, m, rad].
        parameters : Parameters
            Parameters of the registration.
        yaw : float
            Angle [rad] by which `lidars.turned` rotated the scans before the odometry.
        """
        turn = np.array([[0.0, 0.0, yaw]])
        turned = compose(compose(turn, poses), -turn)
        graph = self.graph(turned, parameters)
        pairs = self.numbers[graph.constraints.loops.pairs]
        if not len(pairs):
            return ClosedLoops(poses, pairs, graph)
        return ClosedLoops(compose(compose(-turn, _carried(turned, self.numbers, graph.poses)), turn), pairs, graph)


def _carried(poses, numbers, after):
    """Correct all poses: interpolate between the corrections of the previous and the next key frame."""
    each = np.arange(len(poses))
    last = np.clip(np.searchsorted(numbers, each, 'right') - 1, 0, len(numbers) - 1)
    following = np.minimum(last + 1, len(numbers) - 1)
    share = np.clip((each - numbers[last]) / np.maximum(numbers[following] - numbers[last], 1), 0.0, 1.0)[:, None]
    by_last, by_following = (compose(after[k], relative(poses[numbers[k]], poses)) for k in (last, following))
    gap = by_following - by_last
    gap[:, 2] = wrap(gap[:, 2])
    moved = by_last + share * gap
    moved[:, 2] = wrap(moved[:, 2])
    return moved
