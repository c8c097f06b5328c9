# SPDX-License-Identifier: Apache-2.0
"""External priors: predicted motion since the last scan, from wheel odometry, an IMU or transforms."""
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Imu

from ..core.errors import ParameterError
from ..core.geometry.mounting import Mounting
from ..core.geometry.se2 import SE2
from ..core.registration.records import Prior
from ..core.scan import in_nanoseconds
from ..recordings.playback import NOT_MEASURED
from ..robot.base_state import base_motion, external_prior, measured_prior, sensor_prior
from ..robot.parameter_groups import NodePriorParameters
from ..robot.parameters import NodeParameters
from ..robot.pose_history import HeadingHistory, PoseHistory
from .frames.transforms import TransformListener
from .interfaces.endpoints import subscription
from .interfaces.messages import PoseError, planar_from_message
from .throttled_log import ThrottledLog

QUALITY = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)

Predict = Callable[[int], Prior | None]
"""Function of a stamp [ns] that returns the prediction of the motion model."""


class Priors:
    """Makes the external `Prior` of each scan, from the source that ``prior.source`` names.

    Parameters
    ----------
    node : rclpy.node.Node
        The node that subscribes to the source.
    parameters : NodeParameters
        Parameters of the node; may be replaced at any time.
    transforms : TransformListener or None
        Received transforms; None if tf2_msgs is not installed.
    log : ThrottledLog
        Log for data that is missing or invalid.
    on_data : callable
        Function that is called when the source has received data.

    Raises
    ------
    ParameterError
        When ``prior.source`` is tf and tf2_msgs is not installed.
    """

    def __init__(self, node: Node, parameters: NodeParameters, transforms: TransformListener | None, log: ThrottledLog,
                 on_data: Callable[[], None]) -> None:
        self.parameters = parameters
        self._node, self._log = node, log
        self._source: _Source | None = None
        self._missing = False
        self._last: tuple[int, Mounting] | None = None
        name = parameters.prior.source
        if name == 'odometry':
            self._source = _WheelOdometry(node, log, on_data)
        elif name == 'imu':
            self._source = _Gyroscope(node, log, on_data)
        elif name == 'odometry+imu':
            self._source = _WheelsAndGyroscope(node, log, on_data)
        elif name == 'tf':
            if transforms is None:
                raise ParameterError("prior.source = 'tf': needs tf2_msgs, which is not installed; install it, or "
                                     'choose another source')
            self._source = _OdometryFrame(transforms, parameters.prior.frame)

    def restart(self) -> None:
        """Clear the last scan and the data of the source: the odometry was reset."""
        self._last, self._missing = None, False
        if self._source:
            self._source.restart()

    def ready(self, frame: str, stamp: int) -> bool:
        """Whether the prior of the scan in `frame` at `stamp` [ns] is known, or no scan waits for priors any more.

        If the newest data is older than the last scan, the source has stopped, and the scan does not wait.
        """
        return (self._source is None or self._last is None or self._source.covers(frame, stamp)
                or not self._source.covers(frame, self._last[0]))

    def find(self, frame: str, stamp: int, mounting: Mounting, predict: Predict) -> Prior | None:
        """Make the prior of a scan.

        Parameters
        ----------
        frame : str
            Frame of the scan.
        stamp : int
            Stamp of the scan [ns].
        mounting : Mounting
            Mounting of the lidar at the scan.
        predict : callable
            ``predict(stamp)`` returns the prediction of the motion model at `stamp` [ns].

        Returns
        -------
        Prior or None
            None if there is no external prior; then the odometry uses the prediction of the motion model.
        """
        if self._source is None or self._last is None:
            return None
        last_stamp, last_mounting = self._last
        interval = _Interval(frame, last_stamp, stamp, last_mounting, mounting)
        base = self._source.prior(interval, predict, self.parameters.prior)
        self._missing = base is None or self._source.incomplete
        if self._missing:
            self._log.warn(self.fault)
        return base and sensor_prior(base, last_mounting, mounting)

    @property
    def fault(self) -> str:
        """Why the source had no data for the last scan; empty if it had."""
        if self._source is None or not self._missing:
            return ''
        begin, name = f'prior.source is {self.parameters.prior.source!r}, but ', self._source.name
        if name.startswith('/') and not self._node.count_publishers(name):
            return (f'{begin}no node publishes on {name}; the odometry continues without it. Start its driver, or '
                    'remap the topic to that of your robot (-r)')
        instead = 'the other source alone' if self._source.incomplete else 'the constant-velocity prediction'
        return (f'{begin}{name} has no data at the time of the scan; using {instead}. If the data come later than the '
                'scan, raise advanced.input.max_wait above their period')

    def processed(self, stamp: int, mounting: Mounting) -> None:
        """Store mounting and stamp [ns] of a processed scan: the next prior is the motion since this scan."""
        self._last = stamp, mounting


@dataclass(frozen=True)
class _Interval:
    """Time between two scans.

    Attributes
    ----------
    frame : str
        Frame of the later scan.
    start, end : int
        Stamps of the scans [ns].
    start_mounting, end_mounting : Mounting
        Mounting of the lidar at each scan.
    """

    frame: str
    start: int
    end: int
    start_mounting: Mounting
    end_mounting: Mounting

    def predicted(self, predict: Predict) -> Prior | None:
        """Return the prediction of the motion model, as a motion of the base."""
        prior = predict(self.end)
        return prior and base_motion(prior, self.start_mounting, self.end_mounting)


class _Source(Protocol):
    """Base class of the sources that measure the motion of the base between two scans.

    Attributes
    ----------
    name : str
        What may have no data.
    incomplete : bool
        Whether a part of the source had no data for the last prior.
    """

    name: str
    incomplete: bool

    def restart(self) -> None:
        """Clear the data that the source has received."""

    def covers(self, frame: str, stamp: int) -> bool:
        """Whether the source has data at `stamp` [ns] or later."""

    def prior(self, interval: _Interval, predict: Predict, parameters: NodePriorParameters) -> Prior | None:
        """Return the prior of the motion of the base in the interval; None if the source has no data for it."""


class _WheelOdometry:
    """Source of priors: wheel odometry of the base on the topic ``wheel_odom``."""

    incomplete = False

    def __init__(self, node: Node, log: ThrottledLog, on_data: Callable[[], None]) -> None:
        self._poses = PoseHistory()
        self._log = log
        self._on_data = on_data
        self.name = subscription(node, Odometry, 'wheel_odom', self._on_message, QUALITY).topic_name

    def _on_message(self, message: Odometry) -> None:
        try:
            pose = planar_from_message(message.pose.pose)
        except PoseError as error:
            self._log.warn(f'{self.name}: {error}')
            return
        self._poses.add(in_nanoseconds(message.header.stamp), pose)
        self._on_data()

    def restart(self) -> None:
        self._poses.clear()

    def covers(self, _frame: str, stamp: int) -> bool:
        return self._poses.reaches(stamp)

    def prior(self, interval: _Interval, _predict: Predict, parameters: NodePriorParameters) -> Prior | None:
        motion = self._poses.motion(interval.start, interval.end)
        return None if motion is None else measured_prior(motion, parameters)


class _Gyroscope:
    """Source of priors: yaw rate on the topic ``imu``; translation and its covariance from the motion model."""

    incomplete = False

    def __init__(self, node: Node, log: ThrottledLog, on_data: Callable[[], None]) -> None:
        self._headings = HeadingHistory()
        self._log = log
        self._on_data = on_data
        self.name = subscription(node, Imu, 'imu', self._on_message, QUALITY).topic_name

    def _on_message(self, message: Imu) -> None:
        if message.angular_velocity_covariance[0] == NOT_MEASURED:
            self._log.warn(f'{self.name}: angular_velocity_covariance begins with -1, so there is no yaw rate')
            return
        if not math.isfinite(message.angular_velocity.z):
            self._log.warn(f'{self.name}: angular_velocity.z is {message.angular_velocity.z}, so there is no yaw rate; '
                           'expected a number [rad/s]: the driver has to leave such messages out')
            return
        self._headings.add_rate(in_nanoseconds(message.header.stamp), message.angular_velocity.z)
        self._on_data()

    def restart(self) -> None:
        self._headings.clear()

    def covers(self, _frame: str, stamp: int) -> bool:
        return self._headings.reaches(stamp)

    def prior(self, interval: _Interval, predict: Predict, parameters: NodePriorParameters) -> Prior | None:
        return external_prior(None, self.rotation(interval), lambda: interval.predicted(predict), parameters)

    def rotation(self, interval: _Interval) -> SE2 | None:
        """Return the measured rotation; None if it is not known."""
        return self._headings.motion(interval.start, interval.end)


class _WheelsAndGyroscope:
    """Source of priors: translation of the wheels, rotation of the gyroscope; each alone if the other has no data."""

    def __init__(self, node: Node, log: ThrottledLog, on_data: Callable[[], None]) -> None:
        self._wheels, self._gyroscope = _WheelOdometry(node, log, on_data), _Gyroscope(node, log, on_data)
        self.name, self.incomplete = self._wheels.name, False

    def restart(self) -> None:
        self._wheels.restart()
        self._gyroscope.restart()

    def covers(self, frame: str, stamp: int) -> bool:
        return self._wheels.covers(frame, stamp) and self._gyroscope.covers(frame, stamp)

    def prior(self, interval: _Interval, predict: Predict, parameters: NodePriorParameters) -> Prior | None:
        driven = self._wheels.prior(interval, predict, parameters)
        rotation = self._gyroscope.rotation(interval)
        found = external_prior(driven, rotation, lambda: interval.predicted(predict), parameters)
        self.name = self._gyroscope.name if driven else self._wheels.name
        self.incomplete = found is not None and (driven is None or rotation is None)
        return found


class _OdometryFrame:
    """Source of priors: pose of the sensor in an odometry frame on /tf."""

    incomplete = False

    def __init__(self, transforms: TransformListener, frame: str) -> None:
        self._transforms = transforms
        self._frame = frame
        self.name = f'the transform from {frame!r} on /tf'

    def restart(self) -> None:
        """Do nothing: the transform listener clears its transforms itself."""

    def covers(self, frame: str, stamp: int) -> bool:
        return self._pose(frame, stamp) is not None

    def prior(self, interval: _Interval, _predict: Predict, parameters: NodePriorParameters) -> Prior | None:
        start, end = self._pose(interval.frame, interval.start), self._pose(interval.frame, interval.end)
        if start is None or end is None:
            return None
        base_start = start @ interval.start_mounting.pose.inverse()
        base_end = end @ interval.end_mounting.pose.inverse()
        return measured_prior(base_start.inverse() @ base_end, parameters)

    def _pose(self, frame: str, stamp: int) -> SE2 | None:
        return self._transforms.planar(self._frame, frame, stamp)
