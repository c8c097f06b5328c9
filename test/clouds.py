# SPDX-License-Identifier: Apache-2.0
"""Messages of a 3D lidar on a tilted mast."""
import array
import math

import numpy as np
from ros_helpers import transform
from sensor_msgs.msg import PointCloud2, PointField

from dbscan_reg_ros import SE2
from dbscan_reg_ros.node.interfaces.messages import stamp_to_message

PITCH, HEIGHT = math.radians(30.0), 0.8
KIND = np.dtype([('x', '<f4'), ('y', '<f4'), ('z', '<f4'), ('intensity', '<f4'), ('t', '<u4')])
HEIGHTS = 0.0, 0.3, 0.9, 1.4, 2.4
"""Heights of the returns above the floor [m]: all around at those of the floor and of the ceiling, else on walls."""


def cloud_of(scan, tilted=True, factor=1.0):
    """The message of a 3D lidar that sees walls where `scan` has returns, and the floor and the ceiling before them."""
    flat = scan.points[scan.valid]
    points = np.concatenate([np.column_stack((flat * (1.0 if 0.0 < z < 2.0 else 0.4), np.full(len(flat), z - HEIGHT)))
                             for z in HEIGHTS])
    if tilted:
        c, s = math.cos(PITCH), math.sin(PITCH)
        points = points @ np.array(((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)))
    points = factor * points
    rows = np.zeros(len(points), dtype=KIND)
    for name, values in zip('xyz', points.T, strict=True):
        rows[name] = values
    rows['x'][::7] = np.nan
    message = PointCloud2(height=1, width=len(rows), point_step=KIND.itemsize, row_step=KIND.itemsize * len(rows))
    message.header.stamp, message.header.frame_id = stamp_to_message(scan.stamp), 'mast'
    codes = {'<f4': PointField.FLOAT32, '<u4': PointField.UINT32}
    message.fields = [PointField(name=name, offset=offset, datatype=codes[kind.str], count=1)
                      for name, (kind, offset) in KIND.fields.items()]
    message.data = array.array('B', rows.tobytes())
    return message


def mast():
    message = transform('base_link', 'mast', SE2(0.2, -0.1))
    message.transform.translation.z = HEIGHT
    message.transform.rotation.y, message.transform.rotation.w = math.sin(PITCH / 2.0), math.cos(PITCH / 2.0)
    return message
