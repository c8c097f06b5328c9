# SPDX-License-Identifier: Apache-2.0
"""The example in Figure 4 of the paper: a scan, and a second scan made of its points after a known motion."""
from ..core.geometry.se2 import SE2
from ..core.scan import Scan

PAPER_MOTION = SE2(-1.5, 0.8, 0.3)
"""Motion [m, m, rad] that is applied to the points of the scan."""


def moved(scan) -> Scan:
    """Return the points of a scan moved by `PAPER_MOTION`, as a scan in the same beam order."""
    return Scan.from_points(PAPER_MOTION.apply(scan.points), stamp=scan.stamp,
                            angle_increment=scan.geometry.angle_increment)
