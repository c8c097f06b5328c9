# SPDX-License-Identifier: Apache-2.0
"""The laser of a recording on the base, taken as the node takes it."""
from ..core.errors import ParameterError
from ..core.geometry.mounting import Mounting
from ..core.scan import Scan
from ..robot.mounting import mounting_from_parameters


def mounting_of(parameters) -> Mounting:
    """Where `parameters` (`NodeParameters`) say that the laser sits; with ``mounting: tf`` it is the base.

    Raises
    ------
    ParameterError
        When the laser hangs upside down: a replay takes the scans as they are.
    """
    mounting = mounting_from_parameters(parameters) or Mounting()
    if mounting.upside_down:
        raise ParameterError('upside_down = True: a replay takes the laser as upright; set it to false')
    return mounting


def turned(scans, yaw):
    """Yield `scans` of a laser that is turned by `yaw` [rad] on the base, one by one as a sensor that looks along the base
    sees them."""
    geometry = None
    for scan in scans:
        if yaw:
            g = scan.geometry
            scan = Scan.from_fields(scan.stamp, scan.ranges, g.angle_min + yaw, g.angle_increment, g.range_min,
                                    g.range_max, scan.time_increment, scan.frame_id, geometry)
            geometry = scan.geometry
        yield scan
