# SPDX-License-Identifier: Apache-2.0
"""What came of the scans that were played to a node."""
import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np


@dataclass
class Answers:
    """What a node said to the scans played to it.

    Attributes
    ----------
    stamps : list of int
        Of all scans published [ns], in order.
    messages : list of nav_msgs.msg.Odometry or None
        The odometry for each of them; None where there was none.
    delays : list of float
        From publishing each scan to its odometry [s]; nan where there was none.
    unexpected : int
        Odometry messages that belong to no scan that was waiting for one.
    passed : Counter
        Topic -> messages published on it, besides the scans.
    damaged : Counter
        Topic -> messages that could not be, for their bytes are no message of their type.
    """

    stamps: list = field(default_factory=list)
    messages: list = field(default_factory=list)
    delays: list = field(default_factory=list)
    unexpected: int = 0
    passed: Counter = field(default_factory=Counter)
    damaged: Counter = field(default_factory=Counter)

    @property
    def lost(self) -> int:
        """How many scans were published and not answered."""
        return sum(message is None for message in self.messages)

    def poses(self):
        """``(N, 3)`` x [m], y [m] and yaw [rad] for each scan, nan where it was lost."""
        poses = np.full((len(self.messages), 3), math.nan)
        for row, message in zip(poses, self.messages, strict=True):
            if message is not None:
                pose = message.pose.pose
                row[:] = pose.position.x, pose.position.y, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        return poses
