"""Plays scans to a running node over ROS, and collects what it answers."""
import math
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan

from ..command_lines import command_line
from ..core.errors import DbscanRegError
from ..recordings.schedule import Schedule
from .messages import scan_to_message, stamp_from_message, stamp_to_message

DEPTH = 100
WINDOW = 3
"""Scans on the way at a time when playing in lockstep: fewer than a subscription with sensor-data QoS holds."""
CLOCK_PERIOD = 0.025
POLL = 0.02
RETRY = 1.0
"""A call is repeated after this time [s]: the answer is lost while the other side does not know the caller yet."""


class PlayerError(DbscanRegError):
    """There is no node to play to, or it does not answer."""


@dataclass
class Answers:
    """What a node said to the scans played to it.

    Attributes
    ----------
    stamps : list of int
        Of all scans published [ns], in order.
    messages : list of nav_msgs.msg.Odometry or None
        The odometry for each of them; None where there was none.
    delays : list of float
        From publishing each scan to its odometry [s]; nan where there was none.
    unexpected : int
        Odometry messages that belong to no scan that was waiting for one.
    """

    stamps: list = field(default_factory=list)
    messages: list = field(default_factory=list)
    delays: list = field(default_factory=list)
    unexpected: int = 0

    @property
    def lost(self) -> int:
        """How many scans were published and not answered."""
        return sum(message is None for message in self.messages)

    def poses(self):
        """``(N, 3)`` x [m], y [m] and yaw [rad] for each scan, nan where it was lost."""
        poses = np.full((len(self.messages), 3), math.nan)
        for row, message in zip(poses, self.messages, strict=True):
            if message is not None:
                pose = message.pose.pose
                row[:] = pose.position.x, pose.position.y, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        return poses


class Player:
    """A ROS node that publishes scans on ``scan`` and listens to ``odom``; use it in a ``with`` statement.

    Parameters
    ----------
    arguments : list of str
        ROS arguments, for example ``['--ros-args', '-r', 'scan:=laser']``.
    clock : bool
        Publish ``/clock`` as well.
    """

    def __init__(self, arguments=(), clock=False):
        self._context = Context()
        rclpy.init(args=['play', *arguments], context=self._context)
        self._node = Node('play', context=self._context, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._scans = self._node.create_publisher(LaserScan, 'scan', DEPTH)
        self._odom = self._node.create_subscription(Odometry, 'odom', self._on_odometry, DEPTH)
        self._clock = None
        if clock:
            quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._clock = self._node.create_publisher(Clock, '/clock', quality)
        self._begin()

    def _begin(self):
        self._answers = Answers()
        self._waiting = deque(maxlen=DEPTH)
        self._published = []
        self._last_answer = time.monotonic()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()

    def close(self):
        """Leave the ROS graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def wait_for_node(self, timeout=10.0, answering=True):
        """Wait until a node is there and certain to receive the first scan.

        Discovery is mutual but not simultaneous: the node counts as ready when it has answered a call to a service
        of its own, for by then it knows all that this one publishes and hears.

        Parameters
        ----------
        timeout : float
            [s]
        answering : bool
            Wait for a node that also publishes ``odom``, and not for any that hears scans.

        Raises
        ------
        PlayerError
            When there is no such node in time, or it does not answer.
        """
        deadline = time.monotonic() + timeout
        while not (nodes := self._listeners(answering)):
            if time.monotonic() > deadline:
                publishes = f' and publishes {self._odom.topic_name}' if answering else ''
                raise PlayerError(f'no node hears {self._scans.topic_name}{publishes} after {timeout:g} s; start one: '
                                  + command_line('scan_matcher'))
            self._executor.spin_once(POLL)
        for name in nodes:
            self._greet(name, deadline, required=answering)

    def _listeners(self, answering):
        """Full names of the nodes to play to."""
        names = _node_names(self._node.get_subscriptions_info_by_topic(self._scans.topic_name))
        if answering:
            names &= _node_names(self._node.get_publishers_info_by_topic(self._odom.topic_name))
        return names

    def _greet(self, name, deadline, required):
        client = self._node.create_client(GetParameters, f'{name}/get_parameters')
        try:
            while time.monotonic() < deadline:
                if not client.service_is_ready():
                    self._executor.spin_once(POLL)
                    continue
                future = client.call_async(GetParameters.Request())
                self._executor.spin_until_future_complete(future, RETRY)
                if future.done():
                    return
        finally:
            self._node.destroy_client(client)
        if required:
            raise PlayerError(f'the node {name} hears {self._scans.topic_name}, but does not answer; is it blocked?')

    def play(self, scans, rate=None, window=WINDOW, patience=2.0) -> Answers:
        """Publish `scans` in their order, with their own stamps.

        Parameters
        ----------
        scans : iterable of Scan
        rate : float, optional
            Times the speed of their stamps; without it each scan is published as soon as the node has answered
            enough of those before.
        window : int
            How many scans may wait for an answer when no rate is given.
        patience : float
            A scan that has waited this long [s] for an answer, with none for any other, is given up.

        Raises
        ------
        PlayerError
            When an answer is missing and nobody hears the scans any more.
        """
        self._begin()
        schedule = Schedule()
        start = began = None
        for scan in scans:
            due = schedule.time(scan.stamp)
            if rate is None:
                self._wait_for_answers(window - 1, patience)
            else:
                if start is None:
                    start, began = due, time.monotonic()
                self._wait_until(began + (due - start) * 1e-9 / rate, due, rate)
            self._tick(due)
            self._publish(scan)
        if rate is None or any(self._answers.messages):
            self._wait_for_answers(0, patience)
        return self._answers

    def _publish(self, scan):
        self._waiting.append(len(self._answers.stamps))
        self._answers.stamps.append(scan.stamp)
        self._answers.messages.append(None)
        self._answers.delays.append(math.nan)
        if len(self._waiting) == 1:
            self._last_answer = time.monotonic()
        message = scan_to_message(scan)
        self._published.append(time.monotonic())
        self._scans.publish(message)

    def _wait_for_answers(self, allowed, patience):
        """Until no more than `allowed` scans wait for an answer."""
        while len(self._waiting) > allowed:
            remaining = self._last_answer + patience - time.monotonic()
            if remaining <= 0.0:
                if not self._scans.get_subscription_count():
                    answered = sum(message is not None for message in self._answers.messages)
                    raise PlayerError(f'the node that heard {self._scans.topic_name} has gone; it answered {answered} of '
                                      f'{len(self._answers.stamps)} scans')
                self._waiting.popleft()
                self._last_answer = time.monotonic()
            else:
                self._executor.spin_once(remaining)

    def _wait_until(self, moment, due, rate):
        """Until the steady clock shows `moment`, when the schedule shows `due` [ns]; with a clock that ticks."""
        while (remaining := moment - time.monotonic()) > 0.0:
            self._executor.spin_once(min(remaining, CLOCK_PERIOD) if self._clock else remaining)
            if self._clock:
                self._tick(due - max(0, int((moment - time.monotonic()) * rate * 1e9)))

    def _tick(self, now):
        if self._clock:
            self._clock.publish(Clock(clock=stamp_to_message(now)))

    def _on_odometry(self, message):
        stamp = stamp_from_message(message.header.stamp)
        answers = self._answers
        if not any(answers.stamps[index] == stamp for index in self._waiting):
            answers.unexpected += 1
            return
        while answers.stamps[index := self._waiting.popleft()] != stamp:
            pass
        self._last_answer = time.monotonic()
        answers.messages[index] = message
        answers.delays[index] = self._last_answer - self._published[index]


def _node_names(endpoints):
    return {f'{e.node_namespace.rstrip("/")}/{e.node_name}' for e in endpoints if not e.node_name.startswith('_')}
