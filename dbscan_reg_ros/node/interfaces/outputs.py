# SPDX-License-Identifier: Apache-2.0
"""Publishers of the node; costly messages are made only while they have subscribers."""
import array
import math
import time
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2, PointField

from ...core.features.records import Features
from ...core.geometry.se2 import SE2
from ...core.odometry.records import OdometryUpdate
from ...core.scan import SECOND
from ...recordings.message_fields import odometry_numbers
from ...robot import occupancy
from ...robot.base_state import BaseState
from ...robot.parameters import NodeParameters
from .endpoints import publisher
from .messages import PreparedMessage, pose_to_message, segments_to_message, stamp_to_message
from .topics import LOCAL_GRID, LOCAL_MAP, ODOM, PATH, SEGMENTS

ODOM_NUMBERS = 85
"""Of a pose, a twist and their covariances."""
PICTURE_PERIOD = 0.5
"""Interval [s] at which path and local_map are published."""
REACH = 20.0
"""Length [m] at which rays of local_grid end, which bounds its size."""


@dataclass(eq=False)
class _KeyFrame:
    """Features and pose of a key frame, and the cells of local_grid that it observes, None until they are needed."""

    features: Features
    pose: SE2
    patch: occupancy.Patch | None = None


class Outputs:
    """Publishes ``odom`` and ``segments`` for each scan, ``path`` and ``local_map`` twice a second.

    With ``publish_grid`` also ``local_grid``, when `publish_grid` is called. The `parameters` and the number of
    `lidars` may change at any time. Raises a ParameterError when a QoS override in the parameters is invalid.
    """

    def __init__(self, node: Node, parameters: NodeParameters) -> None:
        self.parameters, self.lidars = parameters, len(parameters.scan_topics)
        self.odom, self._segments, self._path, self._map = (
            publisher(node, topic) for topic in (ODOM, SEGMENTS, PATH, LOCAL_MAP))
        self._grid = publisher(node, LOCAL_GRID) if parameters.publish_grid else None
        odometry = Odometry(child_frame_id=parameters.base_frame)
        odometry.header.frame_id = parameters.odom_frame
        self._odometry = PreparedMessage(odometry, ODOM_NUMBERS)
        self.reset()

    def reset(self) -> None:
        """Begin a new path and a new map."""
        self._poses: list[tuple[int, SE2]] = []
        self._key_frames: list[_KeyFrame] = []
        self._latest: tuple[BaseState, SE2] | None = None
        self._has_new_pose = self._has_new_key_frame = False
        self._next_picture = 0.0
        self._predicted = -1

    def publish(self, update: OdometryUpdate, state: BaseState, origin: SE2) -> None:
        """Publish the result of one scan, with the `state` of the base at the scan.

        `origin` is the pose, in `odom_frame`, of the frame in which `update` expresses poses.
        """
        if not 0 <= self._predicted - state.stamp <= self.parameters.time.max_jump * SECOND:
            self._odometry.publish(self.odom, state.stamp, odometry_numbers(state))
        if self._segments.get_subscription_count():
            self._segments.publish(segments_to_message(update, origin, self.parameters.odom_frame))
        self._extend_path(state)
        self.keep(update)
        self._latest, self._has_new_pose = (state, origin), True
        if time.monotonic() >= self._next_picture:
            self.publish_pictures()

    def publish_predicted(self, state: BaseState) -> None:
        """Publish ``odom`` between two scans; scans with older stamps publish none."""
        self._predicted = state.stamp
        self._odometry.publish(self.odom, state.stamp, odometry_numbers(state))

    def keep(self, update: OdometryUpdate) -> None:
        """Store the last ``odometry.key_frames`` key frames of each lidar for ``local_map``."""
        if update.starts_track:
            self._key_frames.clear()
        if update.is_key_frame:
            self._key_frames.append(_KeyFrame(update.features, update.scan_pose))
            self._has_new_key_frame = True
        del self._key_frames[:-self.parameters.odometry.key_frames * self.lidars]

    def _extend_path(self, state: BaseState) -> None:
        """Add the pose to the path when it is at least ``path.step`` away from the last pose of the path."""
        path = self.parameters.path
        last = self._poses[-1][1] if self._poses else None
        if last is None or math.hypot(state.pose.x - last.x, state.pose.y - last.y) >= path.step:
            self._poses.append((state.stamp, state.pose))
        del self._poses[:-path.size]

    def publish_pictures(self) -> None:
        """Publish ``path`` and ``local_map`` if they have changed since they were last published."""
        if self._latest is None or not self._has_new_pose:
            return
        self._next_picture = time.monotonic() + PICTURE_PERIOD
        (state, origin), self._has_new_pose = self._latest, False
        if self._path.get_subscription_count():
            self._path.publish(self._path_message(state))
        if self._map.get_subscription_count():
            points = np.concatenate([(origin @ frame.pose).apply(frame.features.points) for frame in self._key_frames])
            self._map.publish(cloud_message(points, state.stamp, self.parameters.odom_frame))

    def publish_grid(self) -> None:
        """Publish ``local_grid``, with the parameter of the same name, if there is a new key frame."""
        if self._grid is None or self._latest is None or not self._has_new_key_frame:
            return
        self._has_new_key_frame = False
        (state, origin), resolution = self._latest, self.parameters.grid_resolution
        counts = occupancy.OccupancyCounts(resolution)
        for frame in self._key_frames:
            if frame.patch is None:
                pose = origin @ frame.pose
                frame.patch = occupancy.trace_rays(pose.apply(frame.features.points), pose.as_array()[:2], resolution,
                                                   REACH)
            counts.add(frame.patch)
        grid = counts.grid()
        self._grid.publish(grid_message(grid.values, SE2(*grid.corner), grid.resolution, state.stamp,
                                        self.parameters.odom_frame))

    def _path_message(self, state: BaseState) -> Path:
        poses = [*self._poses, (state.stamp, state.pose)]
        message = Path(poses=[PoseStamped(pose=pose_to_message(pose)) for _, pose in poses])
        for stamped, (stamp, _) in zip(message.poses, poses, strict=True):
            stamped.header.stamp, stamped.header.frame_id = stamp_to_message(stamp), self.parameters.odom_frame
        message.header.stamp, message.header.frame_id = stamp_to_message(state.stamp), self.parameters.odom_frame
        return message


def grid_message(values: NDArray[np.int8], origin: SE2, resolution: float, stamp: int, frame: str) -> OccupancyGrid:
    """Make the OccupancyGrid of `values` (H, W) in `frame` at `stamp` [ns]; `origin` is the pose of their corner."""
    message = OccupancyGrid(data=array.array('b', values.tobytes()))
    message.header.stamp, message.header.frame_id = stamp_to_message(stamp), frame
    message.info.map_load_time, message.info.resolution = message.header.stamp, resolution
    message.info.height, message.info.width = values.shape
    message.info.origin = pose_to_message(origin)
    return message


def cloud_message(points: NDArray[np.float64], stamp: int, frame: str) -> PointCloud2:
    """Make the PointCloud2 of planar `points` ``(N, 2)`` [m] in `frame` with z = 0, at `stamp` [ns]."""
    data = np.zeros((len(points), 3), dtype='<f4')
    data[:, :2] = points
    message = PointCloud2(height=1, width=len(points), point_step=12, row_step=12 * len(points), is_dense=True)
    message.header.stamp, message.header.frame_id = stamp_to_message(stamp), frame
    message.fields = [PointField(name=name, offset=4 * k, datatype=PointField.FLOAT32, count=1)
                      for k, name in enumerate('xyz')]
    message.data = array.array('B', data.tobytes())
    return message
