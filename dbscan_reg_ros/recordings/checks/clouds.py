# SPDX-License-Identifier: Apache-2.0
"""Checks of point clouds: their unit, and the axes of their frame."""
import numpy as np

from ...core.errors import ScanError
from ...robot.point_cloud import some_points
from .ranges import TOO_LARGE, UNITS
from .scan_warnings import Kind, LastingWarnings

FEWEST = 20
"""Fewest points of a message that are judged."""
ROOMS = 500.0, 3000.0
"""Below the first median distance points cannot be in millimetres, above the second not in centimetres: they would be
nearer than 0.5 m, or farther than 30 m."""
STEEP, NEARLY_ALL = 0.5, 0.95
"""The frame has the axes of a camera if this fraction of the points lies upwards of the sensor, steeper than this
slope; a lidar or a camera that looks ahead sees at least as much below itself."""


class CloudChecks:
    """Check the point clouds of one lidar one by one."""

    def __init__(self):
        self._warnings = LastingWarnings()

    def look(self, message, matrix) -> list:
        """Return the warnings about a PointCloud2 message; `matrix` transforms points to the base frame."""
        try:
            points = some_points(message)
        except ScanError:
            return []
        if len(points) < FEWEST:
            return []
        median = float(np.median(np.linalg.norm(points, axis=1)))
        if median > TOO_LARGE:
            units = [unit for unit, fits in zip(UNITS, (median >= ROOMS[0], median <= ROOMS[1]), strict=True) if fits]
            kind, names = UNITS[units[0]][0], ' or '.join(UNITS[unit][1] for unit in units)
            return [self._warnings.of(kind, kind, lambda: (
                f'the points look like {names}: half of them are farther away than {median:.6g}; expected metres: have '
                f'the driver divide by {" or ".join(map(str, units))}'))]
        turned = points @ matrix[:3, :3].T
        if np.mean(turned[:, 2] > STEEP * np.hypot(turned[:, 0], turned[:, 1])) < NEARLY_ALL:
            return []
        frame = message.header.frame_id
        return [self._warnings.of(Kind.OPTICAL_FRAME, frame, lambda: (
            f'nearly all points lie above the sensor: they have the axes of a camera, z forward, but {frame!r} has z '
            'up; expected x forward, or a transform from base_link to the optical frame (roll -90 deg, yaw -90 deg): '
            'mend header.frame_id or the transform'))]
