# SPDX-License-Identifier: Apache-2.0
"""Listener to the scans, the odometry and the reports of a running node, and the lidars that it has."""
import math
from collections import OrderedDict, deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.subscription import Subscription
from rclpy.task import Future

from ...core.errors import ParameterError, ScanError
from ...core.geometry.mounting import Mounting, MountingError
from ...core.geometry.se2 import SE2
from ...core.scan import Scan, in_nanoseconds
from ...robot.mask import corrected_stamp
from ...robot.parameter_groups import LASER_SCAN, InputParameters
from ...robot.parameters import NodeParameters
from ...robot.sensors import sensor_descriptions
from ..frames.mountings import Mountings, Transforms
from ..frames.transform_store import TransformStore
from ..interfaces.graph_checks import UNNAMED, full_name, publishers
from ..interfaces.messages import PoseError, planar_from_message, stamp_to_message
from ..interfaces.scan_reader import ScanMessage, ScanReader
from ..interfaces.topics import DIAGNOSTICS, ODOM, TF_STATIC, TYPES, best_effort
from ..own_node import OwnNode
from ..rclpy_internals import NO_SUBSCRIPTION_EVENTS
from ..throttled_log import ThrottledLog

QUALITY = best_effort(20)
"""Scans and odometry may be lost: a page shows the latest."""
WAITING = 50
"""Largest number of scans that wait for the parameters of the node, of scans that wait for the odometry with the same
stamp, and of odometry messages that wait for the scan."""
PLANAR = np.array((0, 1, 5))
"""Rows of x, y and yaw in the 6x6 covariance of an odometry message."""


class WatchedScan(NamedTuple):
    """One scan with the odometry that the node published for this scan."""

    stamp: int
    """[ns]"""
    points: NDArray[np.float64]
    """Returns in the frame of the sensor ``(P, 2)`` [m]; if it is mounted upside down, in the frame of an upright
    sensor."""
    pose: SE2
    """Pose of the sensor in the odometry frame."""
    covariance: NDArray[np.float64]
    """Covariance of the pose (x, y, theta) of the base, in the odometry frame ``(3, 3)`` [m, m, rad]."""
    speed: float
    """[m/s]"""


class Listener(OwnNode):
    """Node that subscribes to ``scan``, ``odom`` and ``/diagnostics`` between `subscribe` and `unsubscribe`.

    If the node has other or several lidars, it subscribes to the scans of each, and passes on the scans whose stamps
    are those of odometry messages: to `on_scan` as `WatchedScan`. `on_report` gets level (0 to 3) and message of each
    diagnostics report of the node, `on_node` its name when another or a restarted node publishes the odometry.
    """

    def __init__(self, on_scan: Callable[[WatchedScan], None], on_report: Callable[[int, str], None],
                 on_node: Callable[[str], None], arguments: Sequence[str] = ()) -> None:
        self._on_scan, self._on_report, self._on_node = on_scan, on_report, on_node
        super().__init__('watch', arguments, start_parameter_services=False)
        self._subscriptions: list[Subscription] = []
        self._timer = self._node.create_timer(0.5, self._look_for_node)
        self._lidars: WatchedLidars | None = None
        self._begin()

    def _begin(self) -> None:
        """Clear the name of the node, its parameters, the transforms and the pending messages."""
        self._source: bytes | None = None
        self._name = ''
        self._unread: deque[tuple[str, ScanMessage]] = deque(maxlen=WAITING)
        self._scans: OrderedDict[int, tuple[Scan, Mounting]] = OrderedDict()
        self._poses: OrderedDict[int, Odometry] = OrderedDict()
        if self._lidars:
            self._lidars.close()
        self._lidars = None
        self._transforms = TransformStore()

    @property
    def topics(self) -> list[str]:
        """Full names of the topics that the listener subscribes to."""
        return [self._node.resolve_topic_name(name) for name in ('scan', ODOM.name, DIAGNOSTICS.name)]

    def spin(self, timeout: float) -> None:
        """Handle the messages that arrive within `timeout` [s]."""
        self._executor.spin_once(timeout)

    def subscribe(self) -> None:
        """Subscribe to scans, odometry, diagnostics and transforms, unless already subscribed."""
        if self._subscriptions:
            return
        self._begin()
        wanted = [(ODOM.kind, ODOM.name, self._take_odometry, QUALITY),
                  (DIAGNOSTICS.kind, DIAGNOSTICS.name, self._take_reports, DIAGNOSTICS.quality)]
        if TF_STATIC.kind is not None:
            wanted += [(TF_STATIC.kind, TF_STATIC.name, lambda message: self._take_transforms(message, True),
                        TF_STATIC.quality)]
        self._subscriptions = [self._node.create_subscription(*each, event_callbacks=NO_SUBSCRIPTION_EVENTS)
                               for each in wanted]
        self._subscribe_to_lidar(self._node.resolve_topic_name('scan'), LASER_SCAN)

    def unsubscribe(self) -> None:
        """End all subscriptions."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        self._subscriptions = []

    def _look_for_node(self) -> None:
        """If another node publishes the odometry now, clear the old data and request the mounting of its lidar."""
        if not self._subscriptions:
            return
        found = publishers(self._node, self._node.resolve_topic_name(ODOM.name))
        if self._source in found:
            self._subscribe_to_scans()
            self._read_scans()
        if not found or self._source in found:
            return
        source, endpoint = next(iter(found.items()))
        name = full_name(endpoint)
        if name == UNNAMED:
            return
        self._begin()
        self._source, self._name = source, name
        self._on_node(self._name)
        self._lidars = WatchedLidars(self._node, self._name, self._transforms)

    def _subscribe_to_scans(self) -> None:
        """Subscribe to all topics of scans that the node subscribes to: it may have several lidars."""
        namespace, _, name = self._name.rpartition('/')
        try:
            found = self._node.get_subscriber_names_and_types_by_node(name, namespace or '/')
        except RuntimeError:
            return
        known = {subscription.topic_name: subscription for subscription in self._subscriptions}
        for topic, kinds in found:
            kind = next((each for each in TYPES if each.replace('/', '/msg/') in kinds), None)
            there = known.get(topic)
            if kind and there and there.msg_type is not TYPES[kind]:
                # The new subscription follows at the next call: the executor keeps the old one until it has run.
                self._subscriptions.remove(there)
                self._node.destroy_subscription(there)
            elif kind and not there:
                self._subscribe_to_lidar(topic, kind)

    def _subscribe_to_lidar(self, topic: str, kind: str) -> None:
        """Subscribe to the messages of the type `kind`, one of `TYPES`, on the full name of a topic."""
        self._subscriptions.append(self._node.create_subscription(
            TYPES[kind], topic, lambda message: self._take_scan(topic, message), QUALITY,
            event_callbacks=NO_SUBSCRIPTION_EVENTS))

    def _take_scan(self, topic: str, message: ScanMessage) -> None:
        if self._lidars is not None:
            self._unread.append((topic, message))
            self._read_scans()

    def _read_scans(self) -> None:
        """Keep the scans once the parameters of the node are known, but those damaged or with an unknown mounting."""
        while self._lidars is not None and self._lidars.are_known() and self._unread:
            try:
                scan, mounting = self._lidars.read(*self._unread.popleft())
            except (ScanError, MountingError):
                continue
            self._keep(self._scans, scan.stamp, (scan, mounting))

    def _take_odometry(self, message: Odometry) -> None:
        self._keep(self._poses, in_nanoseconds(message.header.stamp), message)

    def _keep(self, waiting: OrderedDict[int, Any], stamp: int, message: Any) -> None:
        """Store a scan or an odometry message until the message with the same stamp arrives."""
        waiting[stamp] = message
        while len(waiting) > WAITING:
            waiting.popitem(last=False)
        if stamp in self._scans and stamp in self._poses:
            self._join(*self._scans.pop(stamp), self._poses.pop(stamp))

    def _join(self, scan: Scan, mounting: Mounting, odometry: Odometry) -> None:
        """Pass a scan of a sensor at the `aligned_pose` of a mounting, with its odometry, to `on_scan`."""
        try:
            pose = planar_from_message(odometry.pose.pose) @ mounting.pose
        except PoseError:
            return
        covariance = np.array(odometry.pose.covariance).reshape(6, 6)[np.ix_(PLANAR, PLANAR)]
        if not np.isfinite(covariance).all():
            return
        velocity = odometry.twist.twist.linear
        points = SE2(theta=-mounting.pose.theta).apply(scan.points[scan.valid])
        self._on_scan(WatchedScan(scan.stamp, points, pose, covariance, math.hypot(velocity.x, velocity.y)))

    def _take_transforms(self, message: Any, static: bool) -> None:
        for transform in message.transforms:
            self._transforms.add(transform, static)

    def _take_reports(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if self._name and status.name == f'{self._name}: laser odometry':
                self._on_report(int.from_bytes(status.level, 'little'), status.message)


PLAIN = NodeParameters.describe()


class WatchedLidars:
    """Converts the scans of all lidars of the node with the full name `name` as that node does; our `node` asks it."""

    def __init__(self, node: Node, name: str, transforms: Transforms) -> None:
        self._node, self._namespace = node, name.rpartition('/')[0]
        self._transforms = transforms
        self._client = node.create_client(GetParameters, f'{name}/get_parameters')
        self._parameters: NodeParameters | None = None
        self._known: dict[str, tuple[ScanReader, Mountings, InputParameters]] = {}

    def close(self) -> None:
        """End the requests."""
        self._node.destroy_client(self._client)

    def are_known(self) -> bool:
        """Whether the parameters are known; if not, request them."""
        if self._parameters is None and self._client.service_is_ready():
            self._request([each.name for each in PLAIN], {})
        return self._parameters is not None

    def _request(self, names: list[str], known: dict[str, Any]) -> None:
        future = self._client.call_async(GetParameters.Request(names=names))
        future.add_done_callback(lambda done: self._take(names, known, done))

    def _take(self, names: list[str], known: dict[str, Any], future: Future) -> None:
        """Keep the parameters; first request those of lidars with names."""
        values = [parameter_value_to_python(value) for value in future.result().values]
        known = known | {name: value for name, value in zip(names, values, strict=False) if value is not None}
        own = [name for name in sensor_descriptions(known.get('sensors'), PLAIN) if name not in names]
        if own:
            self._request(own, known)
            return
        try:
            self._parameters = NodeParameters().replace(known)
        except ParameterError:
            # A node of another version: the defaults are assumed.
            self._parameters = NodeParameters()

    def read(self, topic: str, message: ScanMessage) -> tuple[Scan, Mounting]:
        """Convert a message on a `topic`, with the stamp that the node gives it; as `ScanReader.read`, with its errors.

        The parameters must be known.
        """
        assert self._parameters is not None
        reader, mountings, given = self._lidar(topic, self._parameters)
        stamp = corrected_stamp(in_nanoseconds(message.header.stamp), given.time_offset[0])
        message.header.stamp = stamp_to_message(stamp)
        return reader.read(message, mountings, given)

    def _lidar(self, topic: str, parameters: NodeParameters) -> tuple[ScanReader, Mountings, InputParameters]:
        """Return what reads the scans on a `topic`; where it was remapped, those of the first lidar."""
        if topic not in self._known:
            own = next((name for name in parameters.scan_topics if self._full(name) == topic), '')
            lidar, log = parameters.lidar(own), ThrottledLog(self._node.get_logger(), f'{topic}: ')
            self._known[topic] = (ScanReader(self._node.get_clock(), log),
                                  Mountings(parameters.base_frame, lidar, self._transforms), lidar.input)
        return self._known[topic]

    def _full(self, topic: str) -> str:
        """Full name of a topic of the other node."""
        return topic if topic.startswith('/') else f'{self._namespace}/{topic}'
