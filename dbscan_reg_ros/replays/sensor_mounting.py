# SPDX-License-Identifier: Apache-2.0
"""Mounting of the laser in a replay, from the same parameters as in the node."""
from ..core.errors import ParameterError
from ..core.geometry.mounting import Mounting
from ..core.scan import Scan
from ..core.scan_geometry import ScanGeometry
from ..robot.mounting import mounting_from_parameters


def mounting_of(parameters) -> Mounting:
    """Return the mounting in `parameters` (`NodeParameters`); identity with ``mounting: tf``.

    Raises
    ------
    ParameterError
        When the laser is mounted upside down, which a replay does not support.
    """
    mounting = mounting_from_parameters(parameters) or Mounting()
    if mounting.upside_down:
        raise ParameterError('upside_down = True: a replay takes the laser as upright; set it to false')
    return mounting


def turned(scans, yaw):
    """Yield `scans` of a laser with the mounting angle `yaw` [rad] as of one that looks along the base, one by one."""
    geometry = None
    for scan in scans:
        if yaw:
            g = scan.geometry
            rotated = ScanGeometry(g.angle_min + yaw, g.angle_increment, g.size, g.range_min, g.range_max)
            geometry = rotated.reuse(geometry)
            scan = Scan(scan.stamp, scan.ranges, geometry, scan.time_increment, scan.frame_id)
        yield scan
