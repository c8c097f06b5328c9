"""Scans and results as messages; `Scan.from_message` is the way back."""
import array
import math

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Quaternion, TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from ..core.errors import ScanError
from ..core.records import OdometryUpdate
from ..core.scan import SECOND
from ..core.se2 import SE2
from .mounting import BaseState

PLANE = [0, 1, 5]
"""x, y and yaw among the rows of a 6x6 covariance."""
UNKNOWN_VARIANCE = 1e6
"""Of z, roll and pitch [m^2, rad^2], of which a planar lidar says nothing."""
LEAST_VARIANCE = 1e-9
"""Added to the planar variances [m^2, rad^2]: a filter cannot take in a covariance of zero, that of the first pose."""
LINE_WIDTH = 0.03
COLORS = {
    ('reference', 'matched'): ColorRGBA(r=0.0, g=0.45, b=0.7, a=1.0),
    ('reference', 'unmatched'): ColorRGBA(r=0.6, g=0.6, b=0.6, a=1.0),
    ('current', 'matched'): ColorRGBA(r=0.84, g=0.37, b=0.0, a=1.0),
    ('current', 'unmatched'): ColorRGBA(r=0.94, g=0.89, b=0.26, a=1.0),
}


def angles_disagree(message) -> str:
    """How far `angle_max` of a LaserScan is from what its other fields say; empty within 1.5 beams."""
    last = message.angle_min + (len(message.ranges) - 1) * message.angle_increment
    if abs(message.angle_max - last) <= 1.5 * abs(message.angle_increment):
        return ''
    return (f'angle_max is {message.angle_max:.6g} rad, but {len(message.ranges)} ranges, angle_min and '
            f'angle_increment end at {last:.6g} rad; angle_max is ignored')


def scan_to_message(scan) -> LaserScan:
    """A LaserScan message that `Scan.from_message` turns into the same scan.

    Raises
    ------
    ScanError
        When the bearings are not uniform: a LaserScan cannot hold such a scan.
    """
    geometry = scan.geometry
    if geometry.bearings_given is not None:
        raise ScanError('a LaserScan cannot hold a scan whose bearings are given one by one')
    return LaserScan(
        header=Header(stamp=stamp_to_message(scan.stamp), frame_id=scan.frame_id),
        angle_min=geometry.angle_min, angle_increment=geometry.angle_increment,
        angle_max=geometry.angle_min + (geometry.size - 1) * geometry.angle_increment,
        time_increment=scan.time_increment, range_min=geometry.range_min, range_max=geometry.range_max,
        ranges=array.array('f', scan.ranges.tobytes()))


def stamp_from_message(stamp) -> int:
    """Nanoseconds of a Time message."""
    return stamp.sec * SECOND + stamp.nanosec


def stamp_to_message(stamp) -> Time:
    """The Time message of `stamp` [ns]."""
    seconds, nanoseconds = divmod(int(stamp), SECOND)
    return Time(sec=seconds, nanosec=nanoseconds)


def odometry_to_message(state: BaseState, odom_frame, base_frame) -> Odometry:
    """The Odometry message of the base's pose (in `odom_frame`) and twist (in `base_frame`)."""
    message = Odometry(header=Header(stamp=stamp_to_message(state.stamp), frame_id=odom_frame),
                       child_frame_id=base_frame)
    message.pose.pose.position.x = state.pose.x
    message.pose.pose.position.y = state.pose.y
    message.pose.pose.orientation = _yaw(state.pose.theta)
    message.pose.covariance = _spatial(state.covariance)
    twist = message.twist.twist
    twist.linear.x, twist.linear.y, twist.angular.z = (float(v) for v in state.twist)
    message.twist.covariance = _spatial(state.twist_covariance)
    return message


def transform_to_message(state: BaseState, odom_frame, base_frame) -> TransformStamped:
    """The transform from `odom_frame` to `base_frame`."""
    message = TransformStamped(header=Header(stamp=stamp_to_message(state.stamp), frame_id=odom_frame),
                               child_frame_id=base_frame)
    message.transform.translation.x = state.pose.x
    message.transform.translation.y = state.pose.y
    message.transform.rotation = _yaw(state.pose.theta)
    return message


def matrix_from_message(transform):
    """The matrix ``(4, 4)`` of a Transform message; None where its numbers make no rotation."""
    t, q = transform.translation, transform.rotation
    norm = math.sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    if not abs(norm - 1.0) < 0.1 or not all(map(math.isfinite, (t.x, t.y, t.z))):
        return None
    x, y, z, w = q.x / norm, q.y / norm, q.z / norm, q.w / norm
    return np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w), t.x],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w), t.y],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y), t.z],
        [0.0, 0.0, 0.0, 1.0]])


def segments_to_message(update: OdometryUpdate, origin: SE2, odom_frame) -> MarkerArray:
    """The segments of the reference and of the scan, matched ones in stronger colours, in `odom_frame`.

    There are always the same four markers, each adding its lines or deleting those shown before.

    Parameters
    ----------
    update : OdometryUpdate
    origin : SE2
        The sensor's first pose in `odom_frame`.
    odom_frame : str
    """
    header = Header(stamp=stamp_to_message(update.stamp), frame_id=odom_frame)
    matches = update.registration.matches if update.registration else np.empty((0, 2), dtype=int)
    markers = []
    for column, (name, features, pose) in enumerate((('reference', update.reference, update.reference_pose),
                                                     ('current', update.features, update.pose))):
        lines = np.empty((0, 2, 2))
        if features is not None:
            lines = (origin @ pose).apply(np.stack((features.segments.start, features.segments.end), axis=1))
        matched = np.zeros(len(lines), dtype=bool)
        matched[matches[:, column]] = True
        markers += [_lines_marker(header, name, 'matched', lines[matched]),
                    _lines_marker(header, name, 'unmatched', lines[~matched])]
    return MarkerArray(markers=markers)


def _lines_marker(header, name, kind, lines):
    marker = Marker(header=header, ns=name, id=int(kind == 'matched'), type=Marker.LINE_LIST,
                    action=Marker.ADD if len(lines) else Marker.DELETE, color=COLORS[name, kind],
                    points=[Point(x=x, y=y) for x, y in lines.reshape(-1, 2).tolist()])
    marker.scale.x = LINE_WIDTH
    marker.pose.orientation.w = 1.0
    return marker


def _yaw(theta):
    return Quaternion(z=math.sin(theta / 2.0), w=math.cos(theta / 2.0))


def _spatial(planar):
    """The 36 numbers of a spatial covariance from a planar one ``(3, 3)``."""
    covariance = UNKNOWN_VARIANCE * np.eye(6)
    covariance[np.ix_(PLANE, PLANE)] = planar + LEAST_VARIANCE * np.eye(3)
    return covariance.ravel()
