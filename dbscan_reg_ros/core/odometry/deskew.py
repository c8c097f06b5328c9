# SPDX-License-Identifier: Apache-2.0
"""Motion within a scan: every beam as it would have been measured at the scan's stamp."""
import math

import numpy as np

from ..scan import Scan


def deskew(scan: Scan, twist) -> Scan:
    """A scan with the sensor's own motion between its beams taken out.

    Parameters
    ----------
    scan : Scan
        Beam i was measured ``i * time_increment`` after the stamp; an increment of 0 leaves the scan as it is.
    twist : (3,) array_like
        Velocity (vx, vy, omega) of the sensor in its own frame [m/s, m/s, rad/s].

    Returns
    -------
    Scan
        With one bearing for each beam.
    """
    if scan.time_increment == 0.0 or not np.any(twist):
        return scan
    vx, vy, omega = (float(v) for v in twist)
    time = scan.time_increment * np.arange(scan.geometry.size)
    c, s = np.cos(omega * time), np.sin(omega * time)
    x, y = scan.points[:, 0], scan.points[:, 1]
    points = np.stack((c * x - s * y + vx * time, s * x + c * y + vy * time), axis=1)
    if not scan.valid.any():
        return scan
    geometry = scan.geometry
    return Scan.from_points(points, scan.stamp, 0.0, math.inf, scan.frame_id, geometry.angle_increment)
