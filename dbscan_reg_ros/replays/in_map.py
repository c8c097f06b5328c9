# SPDX-License-Identifier: Apache-2.0
"""The drive of a replay in a map that is known before."""
import math

import numpy as np

from ..places.localizer import Localizer, State
from ..places.map_files import load_grid


class InMap:
    """Localises the scans of a replay in the map of a file, and counts what is said.

    Attributes
    ----------
    stamps : list of int [ns]
        Of the scans at which the sensor is localised.
    poses : list of (x, y, theta) [m, m, rad]
        Of the sensor at these scans in the map, turned so that its axes are those of the robot.
    """

    def __init__(self, file, parameters):
        self._localizer = Localizer(load_grid(file, parameters), parameters)
        self.stamps, self.poses = [], []
        self._way, self._last, self._first, self._since, self._state = 0.0, None, math.inf, 0, State.SEARCHING

    def add(self, update):
        """Localise the scan of an `OdometryUpdate`."""
        found, pose = self._localizer.process(update), update.pose
        self._way += math.hypot(pose.x - self._last.x, pose.y - self._last.y) if self._last else 0.0
        self._last, self._state = pose, found.state
        if found.state is State.LOCALISED:
            self._first = min(self._first, self._way)
            self.stamps.append(update.stamp)
            self.poses.append(found.pose.as_tuple())
        self._since += bool(self.stamps)

    def pose_array(self):
        """Poses ``(N, 3)`` of the sensor in the map."""
        return np.array(self.poses, dtype=float).reshape(-1, 3)

    def line(self) -> str:
        """Return the summary in one line."""
        if not self.stamps:
            return f'never localised; at the end {self._state.value}'
        share = 100.0 * len(self.stamps) / self._since
        return (f'localised after {self._first:.2f} m, and at {share:.1f} % of the scans from then on; at the end '
                f'{self._state.value}')
