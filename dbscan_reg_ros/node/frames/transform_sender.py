# SPDX-License-Identifier: Apache-2.0
"""Sender of our transform on /tf, while no other node sends one to the same child frame."""
import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher

from ...core.scan import SECOND, in_nanoseconds
from ...recordings.message_fields import transform_numbers
from ...robot.base_state import BaseState
from ...robot.parameters import NodeParameters
from ..interfaces.endpoints import publisher
from ..interfaces.graph_checks import UNNAMED, full_name, is_scan_matcher, named, publishers
from ..interfaces.messages import PreparedMessage
from ..interfaces.topics import TF

NUMBERS = 7
"""Of a translation and a quaternion."""
COUNT = 4
"""Bytes of a TFMessage before its first transform."""
REMEMBERED = 500
"""Number of our latest transforms that are recognised as ours when they are received on /tf."""
WAIT = 5.0
"""Silence [s] after which another sender of the transform counts as stopped."""


def prepared_transform(parent: str, child: str) -> Any:
    """Return the `PreparedMessage` of a transform from the frame `parent` to `child`; None without tf2_msgs."""
    kind, transform = TF.kind, TransformStamped(child_frame_id=child)
    transform.header.frame_id = parent
    return kind and PreparedMessage(kind(transforms=[transform]), NUMBERS, COUNT)


@dataclass
class _Conflict:
    """Another sender of a transform to our child frame: its topic, its parent frame, and the nodes that it may be."""

    topic: str
    names: str
    parent: str = ''
    heard: float = 0.0
    """Time of the steady clock [s] at which the latest transform was received."""
    latched: set[bytes] = field(default_factory=set)
    """Gids of the publishers on /tf_static, one of which sent the transform; empty if it was received on /tf."""
    logged: bool = False


class TransformSender:
    """Sends the pose of the base on /tf, and is silent while another node sends a transform to the same child frame.

    Of several nodes of this package the one whose publisher has the lowest gid sends first.

    Attributes
    ----------
    active : bool
        Whether our transform is sent while no other node sends one.
    publisher : rclpy publisher or None
        Our publisher on /tf, which also sends the transform from the frame of the map; None if nothing is sent.
    subscribe_static : callable
        Function that subscribes to /tf_static again, so that every latched transform is received again.
    """

    def __init__(self, node: Node, parameters: NodeParameters) -> None:
        self._node = node
        self._invert = parameters.invert_tf
        self._parent, self._child = parameters.odom_frame, parameters.base_frame
        if self._invert:
            self._parent, self._child = self._child, self._parent
        self._message = prepared_transform(self._parent, self._child)
        self.publisher: Publisher | None = None
        self.active = False
        self._own_gid: bytes | None = None
        self._conflict: _Conflict | None = None
        self._start: float | None = None
        self._warned = False
        self._last_stamp: int | None = None
        self._sent: dict[tuple[Any, ...], None] = {}
        self.subscribe_static: Callable[[], None] = lambda: None
        self.reconfigure(parameters, insist=False)

    @property
    def conflict(self) -> str:
        """Log message that names the node that sends our transform in our place; empty when no other node sends it."""
        if self._conflict is None:
            return ''
        until = 'until that publisher has gone' if self._conflict.latched else f'until it is silent for {WAIT:g} s'
        return (f'another node sends a transform to {self._child!r} too, from {self._conflict.parent!r}; publishers on '
                f'{self._conflict.topic}: {self._conflict.names}. A frame has one parent: ours, from '
                f'{self._parent!r}, is not sent {until}, or publish_tf is set to true; stop the other node, or set '
                'publish_tf to false or invert_tf to true')

    def reconfigure(self, parameters: NodeParameters, insist: bool) -> None:
        """Create or destroy the publisher on /tf according to the parameters ``publish_tf`` and ``map.mode``.

        With `insist` the next transform is sent, unless one of another node is received before.

        If tf2_msgs is not installed, log a warning once and send no transform.
        """
        self._max_jump = parameters.time.max_jump * SECOND
        if TF.kind is None:
            if parameters.publish_tf and not self._warned:
                self._node.get_logger().warning('tf2_msgs is not installed: no transform is sent on /tf; '
                                                'install it, or set publish_tf to false')
                self._warned = True
            return
        self.active = parameters.publish_tf
        needed = self.active or parameters.map.mode != 'none'
        if needed and self.publisher is None:
            self._create_publisher()
        elif self.publisher and not needed:
            self._node.destroy_publisher(self.publisher)
            self.publisher = self._own_gid = None
        if not self.active:
            self._conflict = None
        elif insist:
            self._start, self._conflict = -math.inf, None
            self.subscribe_static()

    def _create_publisher(self) -> None:
        before = publishers(self._node, TF.name)
        self.publisher, self._start = publisher(self._node, TF), None
        name = self._node.get_fully_qualified_name()
        self._own_gid = next((gid for gid, endpoint in publishers(self._node, TF.name).items()
                              if gid not in before and full_name(endpoint) == name), None)

    def restart(self) -> None:
        """Send the next transform even if its stamp is not newer: the odometry was reset, or tracking restarted."""
        self._last_stamp = None

    def send(self, state: BaseState) -> None:
        """Send the pose of the base, unless another node sends it or a pose with the same or a newer stamp was sent.

        TF ignores transforms that go back in time. If the stamp is more than ``time.max_jump`` before the last one, the
        last stamp was wrong, and the transform is sent.
        """
        if self._last_stamp is not None and (not state.stamp or 0 <= self._last_stamp - state.stamp <= self._max_jump):
            return
        if self.send_predicted(state):
            self._last_stamp = state.stamp

    def send_predicted(self, state: BaseState) -> bool:
        """Send a pose of the base between two scans; return whether no other node sends our transform."""
        if self.publisher is None or not self.active or self._conflict:
            return False
        if self._start is None:
            self._start = time.monotonic() + self._precedence()
        if time.monotonic() < self._start:
            return False
        numbers = transform_numbers(state.pose.inverse() if self._invert else state.pose)
        signature = (self._parent, state.stamp, *numbers.tolist())
        self._sent[signature] = None
        if len(self._sent) > REMEMBERED:
            del self._sent[next(iter(self._sent))]
        self._message.publish(self.publisher, state.stamp, numbers)
        return True

    def _precedence(self) -> float:
        """Time [s] that a node of this package with a lower gid on /tf is given to start; 0 without such a node."""
        others = publishers(self._node, TF.name).items()
        return WAIT * any(self._own_gid is None or gid < self._own_gid for gid, endpoint in others
                          if gid != self._own_gid and is_scan_matcher(self._node, endpoint))

    def on_transform(self, transform: TransformStamped, topic: str) -> None:
        """Be silent from now on when a transform of another node to our child frame was received."""
        if transform.child_frame_id != self._child or not self.active:
            return
        signature = _signature(transform)
        if topic == TF.name and signature in self._sent:
            # Each own transform is received once: a second one was sent by a node like this one.
            del self._sent[signature]
            return
        if self._conflict is None or (topic == '/tf_static' != self._conflict.topic):
            self._conflict = _Conflict(topic, self._others(topic))
        self._conflict.parent, self._conflict.heard = transform.header.frame_id, time.monotonic()
        if topic == '/tf_static':
            self._conflict.latched = set(publishers(self._node, topic))

    def on_timer(self) -> None:
        """Log which other nodes send our transform; send ours again when they have stopped. Called once a second."""
        conflict, now = self._conflict, time.monotonic()
        if conflict is None:
            return
        if UNNAMED in conflict.names:
            conflict.names = self._others(conflict.topic)
        if not conflict.logged:
            self._node.get_logger().error(self.conflict)
            conflict.logged = True
        if conflict.latched:
            if not conflict.latched <= publishers(self._node, '/tf_static').keys():
                # Which of them sent the transform is unknown; the listener receives again what the others have latched.
                conflict.latched, conflict.heard = set(), now
        elif now - conflict.heard >= WAIT + self._precedence():
            self._conflict = None
            self._node.get_logger().info(f'no other node has sent a transform to {self._child!r} for {WAIT:g} s: ours, '
                                         f'from {self._parent!r}, is sent again')

    def _others(self, topic: str) -> str:
        """Names of the nodes of all other publishers on `topic`."""
        return named(each for gid, each in publishers(self._node, topic).items() if gid != self._own_gid) or UNNAMED


def _signature(transform: TransformStamped) -> tuple[Any, ...]:
    """Values that distinguish our transform from that of another node between the same frames."""
    t, q = transform.transform.translation, transform.transform.rotation
    return transform.header.frame_id, in_nanoseconds(transform.header.stamp), t.x, t.y, t.z, q.x, q.y, q.z, q.w
