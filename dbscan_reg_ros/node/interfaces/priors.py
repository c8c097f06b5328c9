# SPDX-License-Identifier: Apache-2.0
"""What is believed of the sensor's motion before the scans are looked at."""
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu

from ...core.errors import ParameterError
from ...core.geometry.mounting import Mounting, MountingError
from ...core.registration.records import Prior
from ...robot.pose_history import HeadingHistory, PoseHistory
from ..frames.transform_store import NoTransformError
from .endpoints import subscription
from .messages import PoseError, planar_from_message, stamp_from_message

QUALITY = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


class Priors:
    """Makes the `Prior` of each scan as the parameter ``prior.source`` says.

    Parameters
    ----------
    node : rclpy.node.Node
    parameters : NodeParameters
        May be replaced at any time.
    transforms : TransformListener or None
        None where tf2_msgs is not installed.
    notices : Notices
    heard : callable
        Called when a source has said something.

    Raises
    ------
    ParameterError
        When transforms are to be read and there are none.
    """

    def __init__(self, node: Node, parameters, transforms, notices, heard):
        self.parameters = parameters
        self._notices = notices
        name = parameters.prior.source
        if name == 'tf' and transforms is None:
            raise ParameterError("prior.source = 'tf': needs tf2_msgs, which is not installed; install it, or choose "
                                 'another source')
        self._source: Any = {
            'odometry': lambda: _Wheels(node, notices, heard),
            'imu': lambda: _Gyroscope(node, notices, heard),
            'tf': lambda: _Frame(transforms, parameters.prior.frame),
        }.get(name, lambda: None)()
        self._last: tuple | None = None

    def restart(self):
        """Forget the last scan and what the source said: the odometry was reset."""
        self._last = None
        if self._source:
            self._source.restart()

    def ready(self, frame, stamp) -> bool:
        """Whether waiting may tell no more of the motion up to the scan in `frame` at `stamp` [ns].

        A source that does not reach as far as the last scan is quiet: nothing is expected of it.
        """
        return (self._source is None or self._last is None or self._source.reaches(frame, stamp)
                or not self._source.reaches(frame, self._last[0]))

    def find(self, frame, stamp, mounting: Mounting, expected):
        """The `Prior` for the scan in `frame` at `stamp` [ns], or None for the odometry's own.

        `expected(stamp)` is the odometry's own.
        """
        if self._source is None or self._last is None:
            return None
        before, last_mounting = self._last
        asked = _Question(frame, before, stamp, last_mounting, mounting, expected, self.parameters.prior)
        told = self._source.answer(asked)
        if told is None:
            self._notices.warn(f'prior.source is {self.parameters.prior.source!r}, but {self._source.name} says nothing of '
                               'the time of the scan; taking the motion to go on as before')
            return None
        adjoint = mounting.aligned_pose.inverse().adjoint()
        return Prior(last_mounting.aligned_pose.inverse() @ told.transform @ mounting.aligned_pose,
                     adjoint @ told.covariance @ adjoint.T, told.velocity_change)

    def processed(self, stamp, mounting: Mounting):
        """Remember the scan at `stamp` [ns], for the next prior is the motion since then."""
        self._last = stamp, mounting


@dataclass(frozen=True)
class _Question:
    """How did the base move between two scans?

    Attributes
    ----------
    frame : str
        Of the later scan.
    before, now : int [ns]
    last_mounting, mounting : Mounting
    expected : callable
        ``expected(now)``: the sensor's motion if it goes on as before, a `Prior`.
    parameters : NodePriorParameters
    """

    frame: str
    before: int
    now: int
    last_mounting: Mounting
    mounting: Mounting
    expected: Callable
    parameters: Any

    def measured(self, motion) -> Prior:
        return Prior(motion, np.diag(self.parameters.wheel_sigma(motion)) ** 2)

    def going_on(self) -> Prior:
        own = self.expected(self.now)
        return Prior(self.last_mounting.aligned_pose @ own.transform @ self.mounting.aligned_pose.inverse(), own.covariance, own.velocity_change)


class _Wheels:
    """The base's odometry on the topic ``wheel_odom``."""

    def __init__(self, node, notices, heard):
        self._poses = PoseHistory()
        self._notices = notices
        self._heard = heard
        self.name = subscription(node, Odometry, 'wheel_odom', self._on_message, QUALITY).topic_name

    def _on_message(self, message):
        try:
            pose = planar_from_message(message.pose.pose)
        except PoseError as error:
            self._notices.warn(f'{self.name}: {error}')
            return
        self._poses.add(stamp_from_message(message.header.stamp), pose)
        self._heard()

    def restart(self):
        self._poses.clear()

    def reaches(self, _frame, stamp):
        return self._poses.reaches(stamp)

    def answer(self, asked):
        start, end = self._poses.at(asked.before), self._poses.at(asked.now)
        return None if start is None or end is None else asked.measured(start.inverse() @ end)


class _Gyroscope:
    """The yaw rate on the topic ``imu``; the way goes on as before, and is known no better."""

    def __init__(self, node, notices, heard):
        self._headings = HeadingHistory()
        self._notices = notices
        self._heard = heard
        self.name = subscription(node, Imu, 'imu', self._on_message, QUALITY).topic_name

    def _on_message(self, message):
        if message.angular_velocity_covariance[0] == -1.0:
            self._notices.warn(f'{self.name}: angular_velocity_covariance begins with -1, so there is no yaw rate')
            return
        self._headings.add_rate(stamp_from_message(message.header.stamp), message.angular_velocity.z)
        self._heard()

    def restart(self):
        self._headings.clear()

    def reaches(self, _frame, stamp):
        return self._headings.reaches(stamp)

    def answer(self, asked):
        start, end = self._headings.at(asked.before), self._headings.at(asked.now)
        if start is None or end is None:
            return None
        turn = start.inverse() @ end
        return asked.going_on().with_rotation(turn.theta, asked.parameters.wheel_sigma(turn)[2])


class _Frame:
    """The sensor's pose in an odometry frame on /tf."""

    def __init__(self, transforms, frame):
        self._transforms = transforms
        self._frame = frame
        self.name = f'the transform from {frame!r} on /tf'

    def restart(self):
        pass

    def reaches(self, frame, stamp):
        return self._pose(frame, stamp) is not None

    def answer(self, asked):
        start, end = self._pose(asked.frame, asked.before), self._pose(asked.frame, asked.now)
        if start is None or end is None:
            return None
        return asked.measured((start @ asked.last_mounting.pose.inverse()).inverse() @ end @ asked.mounting.pose.inverse())

    def _pose(self, frame, stamp):
        try:
            matrix, known = self._transforms.lookup(self._frame, frame, stamp)
            return Mounting.from_matrix(matrix).pose if known else None
        except (NoTransformError, MountingError):
            return None
