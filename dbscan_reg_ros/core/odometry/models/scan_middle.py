# SPDX-License-Identifier: Apache-2.0
"""The last scan of a sensor, from which a velocity is measured."""
from dataclasses import dataclass

from ...geometry.se2 import SE2


@dataclass
class ScanMiddle:
    """The last scan of one sensor.

    Attributes
    ----------
    pose : SE2
        Pose of the first sensor in the middle of this scan, in the odometry frame.
    time : float [s]
        Time from the middle of this scan to the stamp of the last scan of any sensor.
    degenerate : bool
        Whether a direction of the translation was degenerate for this scan.
    constrained_count : int
        Number of scans of all sensors, up to this scan, that constrained every direction.
    """

    pose: SE2
    time: float
    degenerate: bool
    constrained_count: int
