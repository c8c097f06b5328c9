# SPDX-License-Identifier: Apache-2.0
"""Scans and results as messages; `Scan.from_message` is the way back."""
import math

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose
from sensor_msgs.msg import LaserScan
from visualization_msgs.msg import MarkerArray

from ...core.errors import DbscanRegError
from ...core.geometry.se2 import SE2
from ...core.odometry.records import OdometryUpdate
from ...core.scan import SECOND
from ...recordings.message_fields import filled, pose_fields, scan_fields, segments_fields, time_fields


class PoseError(DbscanRegError, ValueError):
    """A message holds no pose."""


def scan_to_message(scan) -> LaserScan:
    """A LaserScan message that `Scan.from_message` turns into the same scan.

    Raises
    ------
    ScanError
        When the bearings are not uniform: a LaserScan cannot hold such a scan.
    """
    return filled(LaserScan(), scan_fields(scan))


def stamp_from_message(stamp) -> int:
    """Nanoseconds of a Time message."""
    return stamp.sec * SECOND + stamp.nanosec


def stamp_to_message(stamp) -> Time:
    """The Time message of `stamp` [ns]."""
    return filled(Time(), time_fields(stamp))


def pose_to_message(pose: SE2) -> Pose:
    """The Pose message of a planar pose."""
    return filled(Pose(), pose_fields(pose.as_array()))


def pose_from_message(transform):
    """Translation ``(3,)`` and unit quaternion ``(4,)`` (x, y, z, w) of a Transform message; None where its numbers make
    no rotation."""
    t, q = transform.translation, transform.rotation
    norm = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    if not abs(norm - 1.0) < 0.1 or not all(map(math.isfinite, (t.x, t.y, t.z))):
        return None
    return np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w]) / norm


def matrix_from_pose(translation, quaternion):
    """The matrix ``(4, 4)`` of a translation ``(3,)`` and a quaternion ``(4,)`` (x, y, z, w) of any length but 0."""
    x, y, z, w = (quaternion / math.sqrt(quaternion @ quaternion)).tolist()
    tx, ty, tz = translation.tolist()
    return np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w), tx],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w), ty],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y), tz],
        [0.0, 0.0, 0.0, 1.0]])


def matrix_from_message(transform):
    """The matrix ``(4, 4)`` of a Transform message; None where its numbers make no rotation."""
    pose = pose_from_message(transform)
    return None if pose is None else matrix_from_pose(*pose)


def planar_from_message(pose) -> SE2:
    """The planar part of a Pose message: its position, and where its x axis points.

    Raises
    ------
    PoseError
        When its numbers make no pose.
    """
    p, q = pose.position, pose.orientation
    theta = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    if not all(map(math.isfinite, (p.x, p.y, theta))) or not abs(norm - 1.0) < 0.1:
        raise PoseError(f'position ({p.x:g}, {p.y:g}) with the quaternion ({q.x:g}, {q.y:g}, {q.z:g}, {q.w:g}) is no pose; '
                        'expected finite numbers and a quaternion of length 1')
    return SE2(p.x, p.y, theta)


def segments_to_message(update: OdometryUpdate, origin: SE2, odom_frame) -> MarkerArray:
    """The segments of the reference and of the scan, as `segments_fields` says."""
    return filled(MarkerArray(), segments_fields(update, origin, odom_frame))
