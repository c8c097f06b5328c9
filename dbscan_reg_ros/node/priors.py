# SPDX-License-Identifier: Apache-2.0
"""External priors: predicted motion since the last scan, from wheel odometry, an IMU or transforms."""
import math
from collections.abc import Callable

from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import Imu

from ..core.errors import ParameterError
from ..core.geometry.mounting import Mounting
from ..core.geometry.se2 import SE2
from ..core.registration.records import Prior
from ..core.scan import in_nanoseconds
from ..recordings.playback import NOT_MEASURED
from ..robot.base_state import base_motion, external_prior, measured_prior, sensor_prior
from ..robot.parameters import NodeParameters
from ..robot.pose_history import HeadingHistory, PoseHistory
from .frames.transforms import TransformListener
from .interfaces.endpoints import subscription
from .interfaces.messages import PoseError, planar_from_message
from .interfaces.topics import IMU, WHEEL_ODOM
from .throttled_log import ThrottledLog

Predict = Callable[[int], Prior | None]
"""Function of a stamp [ns] that returns the prediction of the motion model."""


class Priors:
    """Makes the external `Prior` of each scan, from the source that ``prior.source`` names.

    The `parameters` may be replaced at any time. `transforms` are None if tf2_msgs is not installed; that is a
    ParameterError if ``prior.source`` is tf. `on_data` is called when the source has received data.
    """

    def __init__(self, node: Node, parameters: NodeParameters, transforms: TransformListener | None, log: ThrottledLog,
                 on_data: Callable[[], None]) -> None:
        self.parameters = parameters
        self._node, self._transforms, self._log, self._on_data = node, transforms, log, on_data
        self._last: tuple[int, Mounting] | None = None
        self._poses, self._headings = PoseHistory(), HeadingHistory()
        self._silent, self._alone = '', False
        sources = parameters.prior.source.split('+')
        self._wheels = self._gyroscope = self._frame = ''
        if 'odometry' in sources:
            self._wheels = subscription(node, WHEEL_ODOM, self._on_wheels).topic_name
        if 'imu' in sources:
            self._gyroscope = subscription(node, IMU, self._on_gyroscope).topic_name
        if 'tf' in sources:
            self._frame = parameters.prior.frame
            if transforms is None:
                raise ParameterError("prior.source = 'tf': needs tf2_msgs, which is not installed; install it, or "
                                     'choose another source')

    def restart(self) -> None:
        """Clear the last scan and the data of the source: the odometry was reset."""
        self._last, self._silent = None, ''
        self._poses.clear()
        self._headings.clear()

    def _on_wheels(self, message: Odometry) -> None:
        try:
            pose = planar_from_message(message.pose.pose)
        except PoseError as error:
            self._log.warn(f'{self._wheels}: {error}')
            return
        self._poses.add(in_nanoseconds(message.header.stamp), pose)
        self._on_data()

    def _on_gyroscope(self, message: Imu) -> None:
        if message.angular_velocity_covariance[0] == NOT_MEASURED:
            self._log.warn(f'{self._gyroscope}: angular_velocity_covariance begins with -1, so there is no yaw rate')
            return
        if not math.isfinite(message.angular_velocity.z):
            self._log.warn(f'{self._gyroscope}: angular_velocity.z is {message.angular_velocity.z}, so there is no yaw '
                           'rate; expected a number [rad/s]: the driver has to leave such messages out')
            return
        self._headings.add_rate(in_nanoseconds(message.header.stamp), message.angular_velocity.z)
        self._on_data()

    def ready(self, frame: str, stamp: int) -> bool:
        """Whether the prior of the scan in `frame` at `stamp` [ns] is known, or no scan waits for priors any more.

        If the newest data is older than the last scan, the source has stopped, and the scan does not wait.
        """
        return self._last is None or self._covers(frame, stamp) or not self._covers(frame, self._last[0])

    def _covers(self, frame: str, stamp: int) -> bool:
        """Whether all sources have data at `stamp` [ns] or later."""
        return ((not self._wheels or self._poses.reaches(stamp))
                and (not self._gyroscope or self._headings.reaches(stamp))
                and (not self._frame or self._pose(frame, stamp) is not None))

    def _pose(self, frame: str, stamp: int) -> SE2 | None:
        """Return the pose of the sensor in the odometry frame on /tf; None if it is unknown."""
        return self._transforms.planar(self._frame, frame, stamp) if self._transforms else None

    def find(self, frame: str, stamp: int, mounting: Mounting, predict: Predict) -> Prior | None:
        """Make the prior of a scan in `frame` at a `stamp` [ns], of a lidar with this `mounting`; None without one.

        Then the odometry uses the prediction of the motion model, which ``predict(stamp)`` returns.
        """
        self._silent = ''
        source = self._wheels or (self._frame and f'the transform from {self._frame!r} on /tf')
        if self._last is None or not (source or self._gyroscope):
            return None
        start, before = self._last
        driven = (self._poses.motion(start, stamp) if self._wheels else
                  self._by_transforms(frame, stamp, mounting) if self._frame else None)
        rotation = self._headings.motion(start, stamp) if self._gyroscope else None
        given = self.parameters.prior

        def predicted() -> Prior | None:
            prior = predict(stamp)
            return prior and base_motion(prior, before, mounting)

        base = external_prior(measured_prior(driven, given) if driven else None, rotation, predicted, given)
        self._silent = (source if source and driven is None else
                        self._gyroscope if self._gyroscope and rotation is None else '')
        self._alone = base is not None
        if self._silent:
            self._log.warn(self.fault)
        return base and sensor_prior(base, before, mounting)

    def _by_transforms(self, frame: str, stamp: int, mounting: Mounting) -> SE2 | None:
        """Return the motion of the base since the last scan by the transforms; None if they are unknown."""
        assert self._last
        poses = [(self._pose(frame, at), mounted) for at, mounted in (self._last, (stamp, mounting))]
        start, end = (pose and pose @ mounted.pose.inverse() for pose, mounted in poses)
        return start.inverse() @ end if start and end else None

    @property
    def fault(self) -> str:
        """Why the source had no data for the last scan; empty if it had."""
        name = self._silent
        if not name:
            return ''
        begin = f'prior.source is {self.parameters.prior.source!r}, but '
        if name.startswith('/') and not self._node.count_publishers(name):
            return (f'{begin}no node publishes on {name}; the odometry continues without it. Start its driver, or '
                    'remap the topic to that of your robot (-r)')
        instead = 'the other source alone' if self._alone else 'the constant-velocity prediction'
        return (f'{begin}{name} has no data at the time of the scan; using {instead}. If the data come later than the '
                'scan, raise advanced.input.max_wait above their period')

    def processed(self, stamp: int, mounting: Mounting) -> None:
        """Store mounting and stamp [ns] of a processed scan: the next prior is the motion since this scan."""
        self._last = stamp, mounting
