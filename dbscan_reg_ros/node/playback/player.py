# SPDX-License-Identifier: Apache-2.0
"""Plays recordings to a running node over ROS, and collects what it answers."""
import math
import time
from collections import deque

import rclpy
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan

from ...command_lines import command_line
from ...core.errors import DbscanRegError
from ...recordings.message_fields import filled, message_class
from ...recordings.playback import Played
from ...recordings.schedule import Timeline
from ..interfaces.messages import scan_to_message, stamp_from_message, stamp_to_message
from .answers import Answers

DEPTH = 100
WINDOW = 3
"""Scans on the way at a time when playing in lockstep: fewer than a subscription with sensor-data QoS holds."""
CLOCK_PERIOD = 0.025
POLL = 0.02
RETRY = 1.0
"""A call is repeated after this time [s]: the answer is lost while the other side does not know the caller yet."""


class PlayerError(DbscanRegError):
    """There is no node to play to, or it does not answer."""


class Player:
    """A ROS node that publishes scans on ``scan`` and listens to ``odom``; use it in a ``with`` statement.

    Parameters
    ----------
    arguments : list of str
        ROS arguments, for example ``['--ros-args', '-r', 'scan:=laser']``.
    clock : bool
        Publish ``/clock`` as well.

    Attributes
    ----------
    answers : Answers
        Of what is being played.
    """

    def __init__(self, arguments=(), clock=False):
        self._context = Context()
        rclpy.init(args=['play', *arguments], context=self._context)
        self._node = Node('play', context=self._context, enable_rosout=False)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._scans = self._node.create_publisher(LaserScan, 'scan', DEPTH)
        self._odom = self._node.create_subscription(Odometry, 'odom', self._on_odometry, DEPTH)
        self._channels = {}
        self._clock, self._now = None, 0
        if clock:
            quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._clock = self._node.create_publisher(Clock, '/clock', quality)
        self._begin()

    def _begin(self):
        self.answers = Answers()
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

    def announce(self, channels) -> list:
        """Get ready to publish what the `channels` of a recording carry; one line for each that cannot be."""
        problems = []
        for channel in channels:
            durability = DurabilityPolicy.TRANSIENT_LOCAL if channel.latched else DurabilityPolicy.VOLATILE
            try:
                kind = message_class(channel.kind)
                publisher = self._node.create_publisher(kind, channel.topic, QoSProfile(depth=DEPTH, durability=durability))
            except (ImportError, AttributeError):
                problems.append(f'{channel.recorded} is not played: its type {channel.kind} is not installed here')
            except InvalidTopicNameException:
                problems.append(f'{channel.recorded} is not played: no ROS 2 topic has such a name')
            else:
                self._channels[channel] = kind, publisher
        return problems

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

    def play(self, items, rate=None, window=WINDOW, patience=2.0) -> Answers:
        """Publish scans in their order, with their own stamps, and between them what else was recorded.

        Parameters
        ----------
        items : iterable of Scan or Played
            What was recorded on a topic that was not announced is left out.
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
        timeline, start = Timeline(), None
        for item in items:
            played = item if isinstance(item, Played) else Played(item)
            due = timeline.due(played)
            if rate is None and not played.channel:
                self._wait_for_answers(window - 1, patience)
            elif rate is not None and due is not None:
                start = start or (due, time.monotonic())
                self._wait_until(start[1] + (due - start[0]) * 1e-9 / rate, due, rate)
            if played.channel:
                self._pass(played)
            else:
                self._tick(due)
                self._publish(played.content)
        if rate is None or any(self.answers.messages):
            self._wait_for_answers(0, patience)
        for publisher in (self._scans, *(publisher for _, publisher in self._channels.values())):
            publisher.wait_for_all_acked(Duration(seconds=patience))
        return self.answers

    def _pass(self, played):
        """Publish what a channel carries, where it is a message that a node can take."""
        if played.channel not in self._channels:
            return
        kind, publisher = self._channels[played.channel]
        content, topic = played.content, played.channel.topic
        try:
            message = filled(kind(), content) if isinstance(content, dict) else deserialize_message(content, kind)
        except Exception:  # noqa: BLE001 - damaged bytes make rclpy raise nearly anything
            self.answers.damaged[topic] += 1
            return
        publisher.publish(message)
        self.answers.passed[topic] += 1

    def _publish(self, scan):
        self._waiting.append(len(self.answers.stamps))
        self.answers.stamps.append(scan.stamp)
        self.answers.messages.append(None)
        self.answers.delays.append(math.nan)
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
                    answered = sum(message is not None for message in self.answers.messages)
                    raise PlayerError(f'the node that heard {self._scans.topic_name} has gone; it answered {answered} of '
                                      f'{len(self.answers.stamps)} scans')
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
            self._now = max(self._now, now)
            self._clock.publish(Clock(clock=stamp_to_message(self._now)))

    def _on_odometry(self, message):
        stamp = stamp_from_message(message.header.stamp)
        answers = self.answers
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
