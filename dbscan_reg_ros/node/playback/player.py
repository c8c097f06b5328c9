# SPDX-License-Identifier: Apache-2.0
"""Player of recordings to a running node; collects the odometry that the node publishes."""
import math
import time
from collections import Counter, deque
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from rcl_interfaces.srv import GetParameters
from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import LaserScan

from ...command_lines import command_line
from ...core.errors import DbscanRegError
from ...core.scan import Scan, in_nanoseconds
from ...recordings.bags.bag import LASER_SCAN
from ...recordings.message_fields import filled, message_class
from ...recordings.playback import Channel, Played, Timeline
from ..interfaces.messages import scan_to_message, stamp_to_message
from ..interfaces.topics import ODOM
from ..own_node import POLL, OwnNode


class Pace:
    """Playback at a constant rate: the time of the recording runs `rate` times as fast as the steady clock."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._start: tuple[int, float] | None = None

    def remaining(self, due: int) -> float:
        """Return the time [s] until the recording time reaches `due` [ns]; 0 at the first call."""
        now = time.monotonic()
        self._start = self._start or (due, now)
        return self._start[1] + (due - self._start[0]) * 1e-9 / self.rate - now


@dataclass
class Answers:
    """Odometry that a node published for the scans played to it."""

    stamps: list[int] = field(default_factory=list)
    """Stamps of all scans published [ns], in order."""
    messages: list[Odometry | None] = field(default_factory=list)
    """Odometry message for each scan; None if none was received."""
    delays: list[float] = field(default_factory=list)
    """Time [s] from publishing each scan to receiving its odometry; nan if none was received."""
    unexpected_stamps: list[int] = field(default_factory=list)
    """Stamps [ns] of odometry messages that do not match a scan that still lacks its odometry."""
    passed: Counter[str] = field(default_factory=Counter)
    """Topic -> number of messages published on this topic; scans are not counted."""
    damaged: Counter[str] = field(default_factory=Counter)
    """Topic -> number of messages that could not be decoded."""

    @property
    def lost(self) -> int:
        """Number of scans that were published and have no odometry."""
        return sum(message is None for message in self.messages)

    @property
    def unexpected(self) -> int:
        """Number of odometry messages that do not match a scan that still lacks its odometry."""
        return len(self.unexpected_stamps)

    def poses(self) -> NDArray[np.float64]:
        """Return the pose ``(N, 3)`` at each scan: x [m], y [m], yaw [rad]; nan if the scan has no odometry."""
        poses = np.full((len(self.messages), 3), math.nan)
        for row, message in zip(poses, self.messages, strict=True):
            if message is not None:
                pose = message.pose.pose
                row[:] = pose.position.x, pose.position.y, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        return poses


DEPTH = 100
WINDOW = 3
"""Number of scans that are published in lockstep before their odometry arrives; fewer than sensor-data QoS can
queue."""
SILENCE = 250_000_000
"""Time [ns] without a scan after which the scans of other lidars are published in real time."""
CLOCK_PERIOD = 0.025
"""Interval [s] between messages on /clock."""


class PlayerError(DbscanRegError):
    """No node subscribes to the scans of the player, or the node does not respond."""


class Player(OwnNode):
    """Node that publishes scans on a `topic` and subscribes to ``odom``; with `clock` it publishes ``/clock``, too.

    `arguments` are those of `OwnNode`. `answers` has the odometry for the scans that are being played.
    """

    def __init__(self, arguments: Sequence[str] = (), clock: bool = False, topic: str = 'scan') -> None:
        super().__init__('play', arguments)
        self._scans = self._node.create_publisher(LaserScan, topic, DEPTH)
        self._odom = self._node.create_subscription(ODOM.kind, ODOM.name, self._on_odometry, DEPTH)
        self._channels: dict[Channel, tuple[type, Publisher]] = {}
        self._clock: Publisher | None = None
        self._now = 0
        if clock:
            quality = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._clock = self._node.create_publisher(Clock, '/clock', quality)
        self._begin()

    def _begin(self) -> None:
        self.answers = Answers()
        self._timeline = Timeline()
        self._waiting: deque[int] = deque(maxlen=DEPTH)
        self._published: list[float] = []
        self._last_answer = time.monotonic()

    def announce(self, channels: Iterable[Channel]) -> list[str]:
        """Create a publisher for each channel of a recording; return a warning for each that cannot be played."""
        problems = []
        for channel in channels:
            durability = DurabilityPolicy.TRANSIENT_LOCAL if channel.latched else DurabilityPolicy.VOLATILE
            try:
                kind = message_class(channel.kind)
                quality = QoSProfile(depth=DEPTH, durability=durability)
                publisher = self._node.create_publisher(kind, channel.topic, quality)
            except (ImportError, AttributeError):
                problems.append(f'{channel.recorded} is not played: its type {channel.kind} is not installed here')
            except InvalidTopicNameException:
                problems.append(f'{channel.recorded} is not played: that is not a valid name of a ROS 2 topic')
            else:
                self._channels[channel] = kind, publisher
        return problems

    def wait_for_node(self, timeout: float = 10.0, answering: bool = True) -> None:
        """Wait until a node runs and is certain to receive the first scan, at most for the `timeout` [s].

        Discovery is mutual but not simultaneous: a node that has responded to a service call has discovered the
        publishers and subscriptions of the player. If `answering` is false, the node need only subscribe to the scans;
        if true, it must also publish ``odom``. Raises a PlayerError when no such node is found, or it does not respond.
        """
        deadline = time.monotonic() + timeout
        while not (nodes := self._subscribers(answering)):
            if time.monotonic() > deadline:
                publishes = f' and publishes {self._odom.topic_name}' if answering else ''
                raise PlayerError(f'no node subscribes to {self._scans.topic_name}{publishes} after {timeout:g} s; '
                                  f'start one: {command_line("scan_matcher")}')
            self._executor.spin_once(POLL)
        for name in nodes:
            response = self.ask(GetParameters, f'{name}/get_parameters', GetParameters.Request(), deadline)
            if response is None and answering:
                raise PlayerError(f'the node {name} subscribes to {self._scans.topic_name}, but does not respond; is '
                                  'it blocked?')

    def _subscribers(self, answering: bool) -> set[str]:
        """Full names of the nodes that subscribe to the scans of the player."""
        names = _node_names(self._node.get_subscriptions_info_by_topic(self._scans.topic_name))
        if answering:
            names &= _node_names(self._node.get_publishers_info_by_topic(self._odom.topic_name))
        return names

    def play(self, items: Iterable[Scan | Played], rate: float | None = None, window: int = WINDOW,
             patience: float = 2.0) -> Answers:
        """Publish scans in their order with their recorded stamps, interleaved with the messages of announced channels.

        Parameters
        ----------
        items : iterable of Scan or Played
            Scans and messages to publish; messages of channels that were not announced are skipped.
        rate : float, optional
            Speed of the playback relative to the stamps. If it is None (lockstep), each scan is published as soon as
            the node has published the odometry for the earlier scans. While there are none, the scans of other lidars
            are published in real time.
        window : int
            In lockstep, number of scans that are published before their odometry arrives.
        patience : float
            Time [s] to wait for the odometry of a scan; then playback goes on without this odometry. If no node
            subscribes to the scans any more, that is a PlayerError.
        """
        self._begin()
        timeline, pace = self._timeline, rate and Pace(rate)
        silence, silent_from = Pace(1.0), 0
        for item in items:
            played = item if isinstance(item, Played) else Played(item)
            due = timeline.due(played)
            if pace:
                self._wait_until(pace, due)
            elif not played.channel:
                self._wait_for_answers(window - 1, patience)
                silence, silent_from = Pace(1.0), due + SILENCE
            elif due > silent_from and played.channel.kind == LASER_SCAN:
                self._wait_until(silence, due)
            self._publish(played, due)
        if not pace or any(self.answers.messages):
            self._wait_for_answers(0, patience)
        self._wait_for_acknowledgement(patience)
        return self.answers

    def _wait_for_acknowledgement(self, patience: float) -> None:
        """Wait until every reliable subscription has received all messages, at most `patience` [s] for each topic."""
        for publisher in (self._scans, *(publisher for _, publisher in self._channels.values())):
            publisher.wait_for_all_acked(Duration(seconds=patience))

    def _publish(self, played: Played, due: int) -> None:
        """Publish a scan or another message, due at this time [ns] of the timeline."""
        if played.channel:
            self._publish_message(played)
        else:
            self._tick(due)
            self._publish_scan(played.content)

    def _publish_message(self, played: Played) -> None:
        """Publish a message of an announced channel; count messages that are damaged."""
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

    def _publish_scan(self, scan: Scan) -> None:
        self._waiting.append(len(self.answers.stamps))
        self.answers.stamps.append(scan.stamp)
        self.answers.messages.append(None)
        self.answers.delays.append(math.nan)
        if len(self._waiting) == 1:
            self._last_answer = time.monotonic()
        message = scan_to_message(scan)
        self._published.append(time.monotonic())
        self._scans.publish(message)

    def _wait_for_answers(self, allowed: int, patience: float) -> None:
        """Wait until at most `allowed` scans await their odometry."""
        while len(self._waiting) > allowed:
            remaining = self._last_answer + patience - time.monotonic()
            if remaining <= 0.0:
                if not self._scans.get_subscription_count():
                    answered = sum(message is not None for message in self.answers.messages)
                    raise PlayerError(f'the node that subscribed to {self._scans.topic_name} has gone; it answered '
                                      f'{answered} of {len(self.answers.stamps)} scans')
                self._waiting.popleft()
                self._last_answer = time.monotonic()
            else:
                self._executor.spin_once(remaining)

    def _wait_until(self, pace: Pace, due: int) -> None:
        """Publish /clock until the time of the timeline reaches `due` [ns]."""
        while (remaining := pace.remaining(due)) > 0.0:
            self._executor.spin_once(min(remaining, CLOCK_PERIOD) if self._clock else remaining)
            if self._clock:
                self._tick(due - max(0, int(pace.remaining(due) * pace.rate * 1e9)))

    def _tick(self, now: int) -> None:
        """Publish the time `now` [ns] of the timeline on /clock if it is asked for and known; it never goes back."""
        if self._clock and self._timeline.start is not None:
            self._now = max(self._now, self._timeline.start + now)
            self._clock.publish(Clock(clock=stamp_to_message(self._now)))

    def _on_odometry(self, message: Odometry) -> None:
        stamp = in_nanoseconds(message.header.stamp)
        answers = self.answers
        if not any(answers.stamps[index] == stamp for index in self._waiting):
            answers.unexpected_stamps.append(stamp)
            return
        while answers.stamps[index := self._waiting.popleft()] != stamp:
            pass
        self._last_answer = time.monotonic()
        answers.messages[index] = message
        answers.delays[index] = self._last_answer - self._published[index]


def _node_names(endpoints: Iterable[TopicEndpointInfo]) -> set[str]:
    """Full names of the nodes of `endpoints`; hidden nodes are left out."""
    return {f'{e.node_namespace.rstrip("/")}/{e.node_name}' for e in endpoints if not e.node_name.startswith('_')}
