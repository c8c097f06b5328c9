# SPDX-License-Identifier: Apache-2.0
"""Deskewing: removes the motion of the sensor within a scan."""
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...scan import Scan


def deskew(scan: Scan, twist: NDArray[np.float64] | Sequence[float]) -> Scan:
    """Transform every beam to what the sensor would have measured at the stamp of the scan.

    Parameters
    ----------
    scan : Scan
        Beam i was measured ``i * time_increment`` [s] after the stamp.
    twist : (3,) float
        Velocity (vx, vy, omega) of the sensor in its own frame [m/s, m/s, rad/s].

    Returns
    -------
    Scan
        The deskewed scan, with one bearing per beam; `scan` itself if the twist or its `time_increment` is 0.
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
    return Scan.from_points(points, scan.stamp, scan.frame_id, geometry.angle_increment)
