# SPDX-License-Identifier: Apache-2.0
"""Conversion of scans, poses and markers to messages, and of poses and transforms from messages."""
import math

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, Transform
from numpy.typing import NDArray
from sensor_msgs.msg import LaserScan
from visualization_msgs.msg import MarkerArray

from ...core.errors import DbscanRegError
from ...core.geometry.se2 import SE2
from ...core.odometry.records import OdometryUpdate
from ...core.scan import Scan
from ...recordings.message_fields import filled, pose_fields, scan_fields, segments_fields, time_fields

Array = NDArray[np.float64]
NORM_TOLERANCE = 0.1
"""Largest deviation of the norm of a quaternion from 1."""


class PoseError(DbscanRegError, ValueError):
    """The values of a message are not a valid pose."""


def scan_to_message(scan: Scan) -> LaserScan:
    """Convert a scan to a LaserScan message, which `Scan.from_message` converts back to the same scan.

    Raises
    ------
    ScanError
        When the bearings are not uniform: a LaserScan cannot represent such a scan.
    """
    return filled(LaserScan(), scan_fields(scan))


def stamp_to_message(stamp: int) -> Time:
    """Convert `stamp` [ns] to a Time message."""
    return filled(Time(), time_fields(stamp))


def pose_to_message(pose: SE2) -> Pose:
    """Convert a planar pose to a Pose message."""
    return filled(Pose(), pose_fields(pose.as_array()))


def pose_from_message(transform: Transform) -> tuple[Array, Array] | None:
    """Convert a Transform message to translation ``(3,)`` and unit quaternion (x, y, z, w); None if invalid."""
    t, q = transform.translation, transform.rotation
    norm = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    if not abs(norm - 1.0) < NORM_TOLERANCE or not all(map(math.isfinite, (t.x, t.y, t.z))):
        return None
    return np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w]) / norm


def matrix_from_pose(translation: Array, quaternion: Array) -> Array:
    """Make the matrix ``(4, 4)`` of a translation ``(3,)`` and a non-zero quaternion ``(4,)`` (x, y, z, w)."""
    x, y, z, w = (quaternion / math.sqrt(quaternion @ quaternion)).tolist()
    tx, ty, tz = translation.tolist()
    return np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w), tx],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w), ty],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y), tz],
        [0.0, 0.0, 0.0, 1.0]])


def matrix_from_message(transform: Transform) -> Array | None:
    """Convert a Transform message to a matrix ``(4, 4)``; None if it is invalid."""
    pose = pose_from_message(transform)
    return None if pose is None else matrix_from_pose(*pose)


def planar_from_message(pose: Pose) -> SE2:
    """Convert a Pose message to a planar pose: x and y of the position, heading from the direction of the x axis.

    Raises
    ------
    PoseError
        When the message is not a valid pose.
    """
    p, q = pose.position, pose.orientation
    theta = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if not all(map(math.isfinite, (p.x, p.y, theta))) or not abs(norm - 1.0) < NORM_TOLERANCE:
        raise PoseError(f'position ({p.x:g}, {p.y:g}) with the quaternion ({q.x:g}, {q.y:g}, {q.z:g}, {q.w:g}) is no '
                        'pose; expected finite numbers and a quaternion of length 1')
    return SE2(p.x, p.y, theta)


def segments_to_message(update: OdometryUpdate, origin: SE2, odom_frame: str) -> MarkerArray:
    """Convert the segments of the reference scan and of the current scan to a MarkerArray message."""
    return filled(MarkerArray(), segments_fields(update, origin, odom_frame))
