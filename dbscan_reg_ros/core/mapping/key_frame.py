# SPDX-License-Identifier: Apache-2.0
"""A scan with its pose, to which later scans are registered: a key frame, or the last scan."""
from dataclasses import dataclass

from ..features.records import Features
from ..geometry.se2 import SE2
from ..sensor import FIRST, Sensor


@dataclass(frozen=True, eq=False)
class KeyFrame:
    """A scan to which later scans are registered; those of a `KeyFrameWindow` are the key frames of the map.

    Attributes
    ----------
    features : Features
    pose : SE2
        Pose of the `sensor` in the odometry frame.
    constrained : bool
        Whether the pose was constrained in every direction. If not, the local map takes no points from this key frame.
    number : int
        `OdometryUpdate.number` of the scan; it does not change if the features of the scan are extracted again.
    sensor : Sensor
        The sensor of the scan.
    """

    features: Features
    pose: SE2
    constrained: bool = True
    number: int = 0
    sensor: Sensor = FIRST
