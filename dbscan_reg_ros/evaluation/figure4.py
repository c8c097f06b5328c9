# SPDX-License-Identifier: Apache-2.0
"""Example of the paper, Figure 4: a scan and its own points after a known motion."""
from ..core.geometry.se2 import SE2
from ..core.scan import Scan

PAPER_MOTION = SE2(-1.5, 0.8, 0.3)
"""From the frame of the scan to that of the moved points [m, m, rad]."""


def moved(scan) -> Scan:
    """Return the points of a scan moved by `PAPER_MOTION`, as a scan in the same beam order."""
    return Scan.from_points(PAPER_MOTION.apply(scan.points), scan.stamp, angle_increment=scan.geometry.angle_increment)
