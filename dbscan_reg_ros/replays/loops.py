# SPDX-License-Identifier: Apache-2.0
"""Loop closing after a drive: correct the trajectory where the sensor returned to a place.

The pose of the odometry must not jump. A map that is drawn after the drive may be corrected as a whole.
"""
from typing import NamedTuple

import numpy as np

from ..core.geometry.se2 import DOF, SE2
from ..core.odometry.records import OdometryUpdate
from ..core.parameters.tree import Parameters
from ..places.mapper import Mapper
from ..recordings.poses import compose


class Loop(NamedTuple):
    """A place seen again.

    `pair` are the numbers of two scans, the earlier first; `motion` is the pose of the later one in the frame of the
    earlier.
    """

    pair: tuple[int, int]
    motion: SE2


class Loops:
    """Builds the map of a drive, and corrects the poses of all scans by it; the parameters are those of `Mapper`.

    Attributes
    ----------
    mapper : Mapper
    found : list of Loop
    """

    def __init__(self, parameters: Parameters = Parameters(), every: bool = True):
        self.mapper = Mapper(parameters, every)
        self.found: list[Loop] = []
        self._frames, self._poses = list[int](), list[tuple]()

    def add(self, update: OdometryUpdate):
        """Use the next scan; return what is known of its pose at this moment, as `Mapper.process` does."""
        known = self.mapper.process(update)
        if again := self.mapper.seen_again:
            self.found.append(Loop((self.mapper.numbers[again.frame], update.number), again.motion))
        frame, odometry = self.mapper.anchor
        self._frames.append(frame)
        self._poses.append((odometry @ update.pose).as_tuple())
        return known

    def poses(self, yaw=0.0):
        """Return the poses (N, 3) [m, m, rad] of all scans by the whole drive; the first is unchanged.

        `yaw` is the angle [rad] by which `lidars.turned` rotated the scans before the odometry.
        """
        turn = np.array([[0.0, 0.0, yaw]])
        poses = compose(self.mapper.graph.poses[self._frames], np.array(self._poses).reshape(-1, DOF))
        return compose(compose(-turn, poses), turn)
