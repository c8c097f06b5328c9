# SPDX-License-Identifier: Apache-2.0
"""Conversion of scans, poses and markers to messages, and of poses from messages."""
import struct
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Pose, PoseWithCovarianceStamped
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from rclpy.serialization import serialize_message
from sensor_msgs.msg import LaserScan
from visualization_msgs.msg import MarkerArray

from ...core.geometry.se2 import SE2
from ...core.odometry.records import OdometryUpdate
from ...core.scan import SECOND, Scan
from ...recordings.message_fields import PLANE, filled, pose_fields, scan_fields, segments_fields, time_fields
from ...recordings.poses import PoseError, planar
from ...robot.base_state import InitialPose

Array = NDArray[np.float64]

STAMP = struct.Struct('=iI')
"""Time message."""
ENCAPSULATION = 4
"""Bytes of a serialised message before its first field."""
ROUNDING = 1e-9
"""A negative eigenvalue of a covariance counts as zero if its absolute value is at most this
fraction of the largest element."""


def scan_to_message(scan: Scan) -> LaserScan:
    """Convert a scan to a LaserScan message, which `Scan.from_message` converts back to the same scan.

    Raises a ScanError when the bearings are not uniform: a LaserScan cannot represent such a scan.
    """
    return filled(LaserScan(), scan_fields(scan))


def stamp_to_message(stamp: int) -> Time:
    """Convert `stamp` [ns] to a Time message."""
    return filled(Time(), time_fields(stamp))


def pose_to_message(pose: SE2) -> Pose:
    """Convert a planar pose to a Pose message."""
    return filled(Pose(), pose_fields(pose.as_array()))


def planar_from_message(pose: Pose) -> SE2:
    """Convert a Pose message to a planar pose: x and y of the position, heading from the direction of the x axis.

    Raises a PoseError when the message is not a valid pose.
    """
    p, q = pose.position, pose.orientation
    return SE2(*planar(p.x, p.y, (q.x, q.y, q.z, q.w)))


def initial_pose(message: PoseWithCovarianceStamped, frame: str) -> InitialPose:
    """Convert a pose of the base, with its covariance, that has to be given in `frame`, or without a frame.

    Raises a PoseError when the frame, the pose or the covariance is not valid.
    """
    if message.header.frame_id not in ('', frame):
        raise PoseError(f'the pose is in {message.header.frame_id!r}; expected {frame!r}')
    pose = planar_from_message(message.pose.pose)
    covariance = 0.5 * np.reshape(message.pose.covariance, (6, 6))[PLANE]
    covariance = covariance + covariance.T
    if not (np.isfinite(covariance).all()
            and np.linalg.eigvalsh(covariance)[0] >= -ROUNDING * np.abs(covariance).max()):
        raise PoseError('its covariance is invalid; expected finite numbers, positive semidefinite')
    return InitialPose(pose, covariance)


def segments_to_message(update: OdometryUpdate, origin: SE2, odom_frame: str) -> MarkerArray:
    """Convert the segments of the reference scan and of the current scan to a MarkerArray message."""
    return filled(MarkerArray(), segments_fields(update, origin, odom_frame))


class PreparedMessage:
    """A message that is serialised once; filling and serialising the fields of each scan takes five times as long.

    The message ends with its `numbers` (how many), all of them float64; a transform or an odometry does. `header` are
    the bytes of its fields before the header.
    """

    def __init__(self, message: Any, numbers: int, header: int = 0) -> None:
        serialized = serialize_message(message)
        begin, end = ENCAPSULATION + header, len(serialized) - 8 * numbers
        self._before, self._between = serialized[:begin], serialized[begin + STAMP.size:end]

    def publish(self, publisher: Publisher, stamp: int, numbers: Array) -> None:
        """Publish the message with another `stamp` [ns] and other numbers."""
        publisher.publish(b''.join((self._before, STAMP.pack(*divmod(stamp, SECOND)), self._between,
                                    numbers.tobytes())))
