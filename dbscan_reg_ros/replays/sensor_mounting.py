# SPDX-License-Identifier: Apache-2.0
"""Mounting, mask and time offset of a lidar in a replay, read from the same parameters as in the node."""
import dataclasses

from ..core.geometry.mounting import Mounting
from ..core.scan import Scan
from ..core.scan_geometry import ScanGeometry
from ..robot.mask import Mask, corrected_stamp
from ..robot.mounting import mounting_from_parameters


def mounting_of(parameters) -> Mounting:
    """Return the mounting in `parameters` (`LidarParameters`); identity with ``mounting: tf``."""
    return mounting_from_parameters(parameters) or Mounting()


def received(scans, parameters, note=None):
    """Yield `scans` as the node uses them: the stamps corrected by ``input.time_offset``, without masked returns.

    `parameters` are the `InputParameters` of this lidar; `note` is called with a sentence on a fault of the mask.
    """
    mask, (offset,) = Mask(), parameters.time_offset
    for scan in scans:
        if offset:
            scan = dataclasses.replace(scan, stamp=corrected_stamp(scan.stamp, offset))
        scan = mask.apply(scan, Mounting(), parameters)
        if note and mask.fault:
            note(mask.fault)
        yield scan


def turned(scans, yaw, upside_down=False):
    """Yield `scans` of a laser with the mounting angle `yaw` [rad], rotated so that their x axis is that of the base.

    Scans of a laser that is mounted upside down are converted to those of an upright laser with the same x axis.
    """
    geometry, sign = None, -1.0 if upside_down else 1.0
    for scan in scans:
        if yaw or upside_down:
            g = scan.geometry
            rotated = ScanGeometry(sign * g.angle_min + yaw, sign * g.angle_increment, g.size, g.range_min, g.range_max)
            geometry = rotated.reuse(geometry)
            scan = Scan(scan.stamp, scan.ranges, geometry, scan.time_increment, scan.frame_id)
        yield scan


def prepared(scans, mounting, parameters, note=None):
    """Yield `scans` of a lidar as the odometry processes them: `received` with `parameters`, and `turned`."""
    return turned(received(scans, parameters, note), mounting.pose.theta, mounting.upside_down)
