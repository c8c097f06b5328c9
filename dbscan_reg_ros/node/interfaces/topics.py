# SPDX-License-Identifier: Apache-2.0
"""The topics of the node: name, type of the messages and quality of service."""
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu, LaserScan, PointCloud2
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from ...robot.parameter_groups import LASER_SCAN, POINT_CLOUD

TYPES = {LASER_SCAN: LaserScan, POINT_CLOUD: PointCloud2}
"""Values of ``input.type`` -> type of the messages."""


def _transform_type() -> Any:
    try:
        from tf2_msgs.msg import TFMessage
    except ModuleNotFoundError:
        return None
    return TFMessage


def reliable(depth: int) -> QoSProfile:
    """Return the default quality of service, with a queue of this depth."""
    return QoSProfile(depth=depth)


def best_effort(depth: int) -> QoSProfile:
    """Return the quality of service that is compatible with every publisher."""
    return QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)


def latched(depth: int) -> QoSProfile:
    """Return the quality of service of messages that late subscribers receive, too."""
    return QoSProfile(depth=depth, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Topic(NamedTuple):
    """Name, type of the messages and quality of service."""

    name: str
    kind: Any
    quality: QoSProfile


MOST_SCANS = 100
"""Largest number of scans that wait to be processed."""
TRANSFORMS = _transform_type()
"""Type of the messages of transforms; None if tf2_msgs is not installed."""


def scans(name: str, kind: str) -> Topic:
    """Return the topic of a lidar; `kind` is a key of `TYPES`. The depth suffices to count the scans that are late."""
    return Topic(name, TYPES[kind], best_effort(MOST_SCANS))


WHEEL_ODOM = Topic('wheel_odom', Odometry, best_effort(100))
IMU = Topic('imu', Imu, best_effort(100))
SET_POSE = Topic('set_pose', PoseWithCovarianceStamped, reliable(10))
TF_IN = Topic('/tf', TRANSFORMS, reliable(1000))
"""As many messages wait to be polled."""
TF_STATIC = Topic('/tf_static', TRANSFORMS, latched(100))

TF = Topic('/tf', TRANSFORMS, reliable(100))
ODOM = Topic('odom', Odometry, reliable(50))
SEGMENTS = Topic('segments', MarkerArray, reliable(5))
PATH = Topic('path', Path, reliable(5))
LOCAL_MAP = Topic('local_map', PointCloud2, reliable(5))
LOCAL_GRID = Topic('local_grid', OccupancyGrid, latched(1))
DIAGNOSTICS = Topic('/diagnostics', DiagnosticArray, reliable(10))

# With `map.mode`
INITIAL_POSE = Topic('initialpose', PoseWithCovarianceStamped, reliable(10))
MAP = Topic('map', OccupancyGrid, latched(1))
MAP_GRAPH = Topic('map_graph', MarkerArray, latched(1))
MAP_STATE = Topic('map_state', String, latched(1))
POSE = Topic('pose', PoseWithCovarianceStamped, reliable(10))
