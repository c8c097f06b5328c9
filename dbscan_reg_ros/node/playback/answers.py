# SPDX-License-Identifier: Apache-2.0
"""Odometry messages that a node published for the scans played to it."""
import math
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from nav_msgs.msg import Odometry
from numpy.typing import NDArray


@dataclass
class Answers:
    """Odometry that a node published for the scans played to it."""

    stamps: list[int] = field(default_factory=list)
    """Stamps of all scans published [ns], in order."""
    messages: list[Odometry | None] = field(default_factory=list)
    """Odometry message for each scan; None if none was received."""
    delays: list[float] = field(default_factory=list)
    """Time [s] from publishing each scan to receiving its odometry; nan if none was received."""
    unexpected_stamps: list[int] = field(default_factory=list)
    """Stamps [ns] of odometry messages that do not match a scan that still lacks its odometry."""
    passed: Counter[str] = field(default_factory=Counter)
    """Topic -> number of messages published on this topic; scans are not counted."""
    damaged: Counter[str] = field(default_factory=Counter)
    """Topic -> number of messages that could not be decoded."""

    @property
    def lost(self) -> int:
        """Number of scans that were published and have no odometry."""
        return sum(message is None for message in self.messages)

    @property
    def unexpected(self) -> int:
        """Number of odometry messages that do not match a scan that still lacks its odometry."""
        return len(self.unexpected_stamps)

    def poses(self) -> NDArray[np.float64]:
        """Return the pose ``(N, 3)`` at each scan: x [m], y [m], yaw [rad]; nan if the scan has no odometry."""
        poses = np.full((len(self.messages), 3), math.nan)
        for row, message in zip(poses, self.messages, strict=True):
            if message is not None:
                pose = message.pose.pose
                row[:] = pose.position.x, pose.position.y, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        return poses
