# SPDX-License-Identifier: Apache-2.0
"""A peer of the node under test: publishes, listens, calls services, and waits with a deadline."""
import contextlib
import importlib.util
import math
import threading
import time

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile

from dbscan_reg_ros import SE2, Scan
from dbscan_reg_ros.node.interfaces.messages import scan_to_message, stamp_to_message

TIMEOUT = 20.0
LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)

needs_tf2_msgs = pytest.mark.skipif(importlib.util.find_spec('tf2_msgs') is None,
                                    reason='needs tf2_msgs (scripts/tf2_msgs/build.py)')


class Peer:
    """A ROS node of the test's own, in its own context; use it in a ``with`` statement."""

    def __init__(self, name='peer'):
        self._context = Context()
        rclpy.init(context=self._context)
        self.node = Node(name, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self._clients, self._answered = {}, set()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()

    def until(self, condition, timeout=TIMEOUT):
        """Spin until `condition` gives something true, and return that."""
        deadline = time.monotonic() + timeout
        while not (result := condition()):
            assert time.monotonic() < deadline, 'the condition did not become true in time'
            self._executor.spin_once(0.05)
        return result

    @contextlib.contextmanager
    def spinning(self):
        """Spin in a thread of its own while the ``with`` statement lasts."""
        ended = threading.Event()

        def spin():
            while not ended.is_set():
                self._executor.spin_once(0.02)

        thread = threading.Thread(target=spin)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def listen(self, kind, topic, quality=100):
        """A list that collects what is published on `topic`, once a publisher is discovered."""
        messages = []
        self.node.create_subscription(kind, topic, messages.append, quality)
        self.until(lambda: self.node.count_publishers(topic))
        return messages

    def subscribe(self, kind, topic):
        """As `listen`, and scan_matcher has discovered the subscription."""
        messages = self.listen(kind, topic)
        self.greet()
        return messages

    def greet(self, node='/scan_matcher'):
        """Wait until a node has discovered this one's publishers and subscriptions: when it has answered a call."""
        self.call(GetParameters, f'{node}/get_parameters', GetParameters.Request())

    def call(self, kind, service, request):
        """The response of a service.

        Until it has answered once, requests are repeated: a response is lost while the other side does not know the
        caller yet.
        """
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, service)
        client = self._clients[service]
        self.until(client.service_is_ready)
        deadline = time.monotonic() + TIMEOUT
        while time.monotonic() < deadline:
            future = client.call_async(request)
            self._executor.spin_until_future_complete(future, 0.25 * TIMEOUT if service in self._answered else 1.0)
            if future.done():
                self._answered.add(service)
                return future.result()
        raise AssertionError(f'{service} does not answer')


class Parameters:
    """The parameters of a running node, through its services, as ``ros2 param`` sees them."""

    def __init__(self, peer, node='/scan_matcher'):
        self._peer = peer
        self._node = node

    def names(self):
        return self._peer.call(ListParameters, f'{self._node}/list_parameters', ListParameters.Request()).result.names

    def describe(self, *names):
        request = DescribeParameters.Request(names=names)
        return self._peer.call(DescribeParameters, f'{self._node}/describe_parameters', request).descriptors

    def get(self, *names):
        request = GetParameters.Request(names=names)
        values = self._peer.call(GetParameters, f'{self._node}/get_parameters', request).values
        return [parameter_value_to_python(value) for value in values]

    def set(self, **values):
        """One result for each, set one by one; two underlines in a name stand for the dot."""
        # The first request sets nothing, so that it can be repeated.
        for request in SetParameters.Request(), SetParameters.Request(parameters=parameter_messages(values)):
            results = self._peer.call(SetParameters, f'{self._node}/set_parameters', request).results
        return results

    def set_together(self, **values):
        """The one result of setting all or none."""
        request = SetParametersAtomically.Request(parameters=parameter_messages(values))
        return self._peer.call(SetParametersAtomically, f'{self._node}/set_parameters_atomically', request).result


def parameter_messages(values) -> list[ParameterMessage]:
    """Messages of name -> value; two underlines in a name stand for the dot."""
    return [Parameter(name.replace('__', '.'), value=value).to_parameter_msg() for name, value in values.items()]


def played(player, scans, rate=None):
    """What a running node answers to `scans`."""
    player.wait_for_node(TIMEOUT)
    return player.play(scans, rate, patience=5.0)


def said(process, text, peer):
    """Wait until the process has printed `text`."""
    peer.until(lambda: text in process.output() or not process.running())
    assert text in process.output()


def pose_of(message) -> SE2:
    """The pose in an Odometry message."""
    pose = message.pose.pose
    return SE2(pose.position.x, pose.position.y, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w))


def distances(messages, truth):
    """How far each message's pose is from the true one [m]."""
    return np.array([math.hypot(pose.x - true.x, pose.y - true.y)
                     for pose, true in zip(map(pose_of, messages), truth, strict=True)])


def squared_distance(before, after, motion):
    """Squared Mahalanobis distance of the motion between two messages from the true one, by the later's covariance."""
    error = (motion.inverse() @ pose_of(before).inverse() @ pose_of(after)).as_array()
    turn = np.eye(3)
    turn[:2, :2] = pose_of(after).rotation()
    covariance = np.reshape(after.pose.covariance, (6, 6))[np.ix_([0, 1, 5], [0, 1, 5])]
    return error @ np.linalg.solve(turn.T @ covariance @ turn, error)


def changed(scan, **fields):
    """The scan's message with some fields changed; `beams` keeps only the first of them."""
    message = scan_to_message(scan)
    beams = fields.pop('beams', len(message.ranges))
    message.ranges = message.ranges[:beams]
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def restamped(scans, stamps):
    """The same scans with the stamps [ns]."""
    return [Scan(int(stamp), s.ranges, s.geometry, s.time_increment, s.frame_id)
            for s, stamp in zip(scans, stamps, strict=True)]


def inverted(scans):
    """The same beams, as published by a lidar in the same place that is mounted upside down and rotated by 180 deg."""
    for scan in scans:
        message = scan_to_message(scan)
        message.angle_min, message.angle_increment = math.pi - message.angle_min, -message.angle_increment
        message.angle_max = message.angle_min + (len(message.ranges) - 1) * message.angle_increment
        yield type(scan).from_message(message)


def transform(parent, child, pose=SE2(), qy=None, stamp=0):
    """A TransformStamped; `qy` is 1 for a rotation of 180 deg about the y axis."""
    message = TransformStamped()
    message.header.stamp = stamp_to_message(stamp)
    message.header.frame_id, message.child_frame_id = parent, child
    message.transform.translation.x, message.transform.translation.y = pose.x, pose.y
    rotation = message.transform.rotation
    if qy is None:
        rotation.z, rotation.w = math.sin(0.5 * pose.theta), math.cos(0.5 * pose.theta)
    else:
        rotation.y, rotation.w = qy, 0.0
    return message


def mounted(laser):
    """Parameters of a node whose laser sits at `laser` on the base."""
    return ['-p', 'mounting:=laser_pose', '-p', f'laser_pose:=[{laser.x}, {laser.y}, {laser.theta}]']


def of_base(truth, laser):
    """The base's pose at each scan, in the frame of its first, from the poses `truth` of the laser."""
    return [laser @ pose @ laser.inverse() for pose in truth]


class Loudspeaker:
    """Publishes the same messages periodically, for subscribers at any time."""

    def __init__(self, peer, kind, topic, quality=100):
        self._peer = peer
        self.publisher = peer.node.create_publisher(kind, topic, quality)
        peer.until(self.publisher.get_subscription_count)

    def tell(self, *messages):
        """Publish `messages` once; every reliable subscription has then received them."""
        for message in messages:
            self.publisher.publish(message)
        assert self.publisher.wait_for_all_acked(Duration(seconds=TIMEOUT))

    def until(self, condition, *messages):
        """Publish `messages` until `condition` gives something true, and return that."""
        deadline = time.monotonic() + TIMEOUT
        while not (result := condition()):
            assert time.monotonic() < deadline, 'the condition did not become true in time'
            for message in messages:
                self.publisher.publish(message)
            with contextlib.suppress(AssertionError):
                return self._peer.until(condition, 0.2)
        return result


def diagnosis(peer, statuses, condition):
    """The first DiagnosticStatus, among the messages of `statuses` from now on, for which `condition` holds."""
    start = len(statuses)
    return peer.until(lambda: next((s for m in statuses[start:] for s in m.status if condition(s)), None))
