# SPDX-License-Identifier: Apache-2.0
"""Scans and results as fields of ROS messages: nested dictionaries, independent of the message library.

Fields that are not named keep the defaults of their type. The node and `rosbag2_py` make ROS messages from these
fields, `rosbags` makes messages of its own classes; the content is the same.
"""
import array
import importlib
import math
from functools import cache

import numpy as np

from ..core.errors import ScanError
from ..core.geometry.se2 import SE2
from ..core.odometry.records import OdometryUpdate
from ..core.scan import SECOND

PLANE = np.ix_([0, 1, 5], [0, 1, 5])
"""Index of the rows and columns of x, y and yaw in a 6x6 covariance."""
UNKNOWN_VARIANCE = 1e6
"""Variance of z, roll and pitch [m^2, rad^2], which a planar lidar does not measure."""
LEAST_VARIANCE = 1e-9
"""Added to the variances of x, y and yaw [m^2, rad^2]: filters cannot use the zero covariance of the first pose."""
UNKNOWN = np.diag(np.full(6, UNKNOWN_VARIANCE))
LEAST = LEAST_VARIANCE * np.eye(3)
LINE_WIDTH = 0.03
LINE_LIST, ADD, DELETE = 5, 0, 2
"""Constants of visualization_msgs/Marker: the type LINE_LIST and the actions ADD and DELETE."""
COLORS = {
    ('reference', 'matched'): {'r': 0.0, 'g': 0.45, 'b': 0.7, 'a': 1.0},
    ('reference', 'unmatched'): {'r': 0.6, 'g': 0.6, 'b': 0.6, 'a': 1.0},
    ('current', 'matched'): {'r': 0.84, 'g': 0.37, 'b': 0.0, 'a': 1.0},
    ('current', 'unmatched'): {'r': 0.94, 'g': 0.89, 'b': 0.26, 'a': 1.0},
}


def filled(message, fields):
    """Set `fields` (name -> value) of a ROS `message` and return it; its other fields stay unchanged."""
    for name, value in fields.items():
        if isinstance(value, dict):
            filled(getattr(message, name), value)
        elif isinstance(value, list):
            setattr(message, name, [filled(_element_class(type(message), name)(), item) for item in value])
        elif isinstance(value, np.ndarray) and value.dtype == np.float32:
            setattr(message, name, array.array('f', value.tobytes()))
        else:
            setattr(message, name, value)
    return message


@cache
def message_class(kind):
    """Return the Python class of a ROS message type, such as ``nav_msgs/msg/Odometry``."""
    package, *_, name = kind.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)


@cache
def _element_class(kind, name):
    """Return the class of the elements of the sequence field `name` in the message class `kind`."""
    return message_class(kind.get_fields_and_field_types()[name].removeprefix('sequence<').removesuffix('>'))


def time_fields(stamp) -> dict:
    """Return the fields of a Time message for a `stamp` [ns]."""
    seconds, nanoseconds = divmod(int(stamp), SECOND)
    return {'sec': seconds, 'nanosec': nanoseconds}


def header_fields(stamp, frame_id) -> dict:
    """Return the fields of a Header with this `stamp` [ns] and `frame_id`."""
    return {'stamp': time_fields(stamp), 'frame_id': frame_id}


def pose_fields(pose) -> dict:
    """Return the fields of a Pose message for a planar `pose`: x, y [m], theta [rad]."""
    x, y, theta = (float(value) for value in pose)
    return {'position': {'x': x, 'y': y}, 'orientation': _yaw(theta)}


def pose_with_covariance_fields(pose, covariance) -> dict:
    """Return the fields of a PoseWithCovariance message of a planar `pose` and its `covariance` (3, 3)."""
    return {'pose': pose_fields(pose), 'covariance': _spatial(covariance)}


def scan_fields(scan) -> dict:
    """Return the fields of a LaserScan message for a `Scan`.

    Raises a ScanError when the bearings are not uniform: a LaserScan cannot represent such a scan.
    """
    geometry = scan.geometry
    if geometry.bearings_given is not None:
        raise ScanError('a LaserScan cannot represent a scan whose bearings are given one by one')
    return {'header': header_fields(scan.stamp, scan.frame_id), 'angle_min': geometry.angle_min,
            'angle_max': geometry.angle_min + (geometry.size - 1) * geometry.angle_increment,
            'angle_increment': geometry.angle_increment, 'time_increment': scan.time_increment,
            'range_min': geometry.range_min, 'range_max': geometry.range_max, 'ranges': scan.ranges}


def pose_only_fields(stamp, child, pose, frame='odom', twist=(0.0, 0.0, 0.0)) -> dict:
    """Return the fields of an Odometry message without covariances.

    `pose` (x, y [m], theta [rad]) is in `frame`, and `twist` (vx, vy [m/s], omega [rad/s]) in the frame `child`.
    """
    return {'header': header_fields(stamp, frame), 'child_frame_id': child, 'pose': {'pose': pose_fields(pose)},
            'twist': {'twist': _twist_fields(twist)}}


def odometry_fields(state, odom_frame, base_frame) -> dict:
    """Return the fields of an Odometry message: pose (in `odom_frame`) and twist (in `base_frame`) of a `BaseState`."""
    return {'header': header_fields(state.stamp, odom_frame), 'child_frame_id': base_frame,
            'pose': pose_with_covariance_fields(state.pose.as_array(), state.covariance),
            'twist': {'twist': _twist_fields(state.twist),
                      'covariance': _spatial(state.twist_covariance)}}


def _twist_fields(twist) -> dict:
    vx, vy, omega = (float(value) for value in twist)
    return {'linear': {'x': vx, 'y': vy}, 'angular': {'z': omega}}


def transform_fields(state, odom_frame, base_frame) -> dict:
    """Return the fields of a TransformStamped from `odom_frame` to `base_frame`."""
    pose = state.pose
    return {'header': header_fields(state.stamp, odom_frame), 'child_frame_id': base_frame,
            'transform': {'translation': {'x': pose.x, 'y': pose.y}, 'rotation': _yaw(pose.theta)}}


def segments_fields(update: OdometryUpdate, origin: SE2, odom_frame) -> dict:
    """Return the fields of a MarkerArray of reference and scan segments in `odom_frame`; matched ones are stronger.

    The array always has the same four markers. The action of a marker is ADD if it has lines, otherwise DELETE.
    `origin` is the sensor's first pose in `odom_frame`.
    """
    header = header_fields(update.stamp, odom_frame)
    matches = update.registration.matches if update.registration else np.empty((0, 2), dtype=int)
    markers = []
    for column, (name, features, pose) in enumerate((('reference', update.reference, update.reference_pose),
                                                     ('current', update.features, update.scan_pose))):
        lines = np.empty((0, 2, 2))
        if features is not None:
            lines = (origin @ pose).apply(np.stack((features.segments.start, features.segments.end), axis=1))
        matched = np.zeros(len(lines), dtype=bool)
        matched[matches[:, column]] = True
        markers += [_lines(header, name, 'matched', lines[matched]), _lines(header, name, 'unmatched', lines[~matched])]
    return {'markers': markers}


def odometry_numbers(state) -> np.ndarray:
    """Return the numbers ``(85,)`` of the Odometry message of a `BaseState` in the order of its fields."""
    pose, (vx, vy, omega) = state.pose, state.twist
    return np.concatenate((transform_numbers(pose), _spatial(state.covariance), (vx, vy, 0.0, 0.0, 0.0, omega),
                           _spatial(state.twist_covariance)))


def transform_numbers(pose) -> np.ndarray:
    """Return the numbers ``(7,)`` of a Pose or Transform message of a planar pose: x, y, z and a quaternion."""
    rotation = _yaw(pose.theta)
    return np.array((pose.x, pose.y, 0.0, 0.0, 0.0, rotation['z'], rotation['w']))


def _lines(header, name, kind, lines):
    return {'header': header, 'ns': name, 'id': int(kind == 'matched'), 'type': LINE_LIST,
            'action': ADD if len(lines) else DELETE, 'color': COLORS[name, kind], 'scale': {'x': LINE_WIDTH},
            'pose': {'orientation': {'w': 1.0}},
            'points': [{'x': x, 'y': y} for x, y in lines.reshape(-1, 2).tolist()]}


def _yaw(theta):
    return {'z': math.sin(theta / 2.0), 'w': math.cos(theta / 2.0)}


def _spatial(planar):
    """Return the 36 numbers of a 6x6 covariance in space from a planar covariance ``(3, 3)`` over x, y, theta."""
    covariance = UNKNOWN.copy()
    covariance[PLANE] = planar + LEAST
    return covariance.ravel()
