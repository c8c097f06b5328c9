# SPDX-License-Identifier: Apache-2.0
"""Sender of our transform on /tf, while no other node sends one to the same child frame."""
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.topic_endpoint_info import TopicEndpointInfo

from ...core.scan import SECOND, in_nanoseconds
from ...recordings.message_fields import transform_numbers
from ...robot.base_state import BaseState
from ...robot.parameters import NodeParameters
from ..interfaces.endpoints import publisher
from ..interfaces.graph_checks import UNNAMED, full_name, may_send_odometry, named, publishers
from ..interfaces.messages import PreparedMessage
from .right_of_way import RightOfWay

DEPTH = 100
NUMBERS = 7
"""Of a translation and a quaternion."""
COUNT = 4
"""Bytes of a TFMessage before its first transform."""
REMEMBERED = 500
"""Number of our latest transforms that are recognised as ours when they are received on /tf."""


def transform_type() -> Any:
    """Return the TFMessage type, or None if tf2_msgs is not installed."""
    try:
        from tf2_msgs.msg import TFMessage
    except ModuleNotFoundError:
        return None
    return TFMessage


@dataclass
class _Conflict:
    """Another sender of a transform to our child frame.

    Attributes
    ----------
    parent, topic : str
        Parent frame and topic of the latest transform of the other sender.
    static_publishers : set of bytes
        Gids of the publishers on /tf_static, one of which sent the transform; empty if it was received on /tf.
    is_new : bool
        Whether a transform was received since the last timer callback.
    names : str
        Names of the nodes that may be the other sender.
    text : str
        Log message that describes the conflict; empty at first.
    logged_names : str
        Names of the nodes in the message that was logged; empty if none was logged.
    """

    parent: str = ''
    topic: str = ''
    static_publishers: set[bytes] = field(default_factory=set)
    is_new: bool = False
    names: str = ''
    text: str = ''
    logged_names: str = ''


class TransformSender:
    """Sends the pose of the base on /tf, and yields to any other sender of a transform to the same child frame.

    Parameters
    ----------
    node : rclpy.node.Node
        The node that publishes.
    parameters : NodeParameters
        Names of the frames, ``publish_tf`` and ``invert_tf``.

    Attributes
    ----------
    subscribe_static : callable
        Function that subscribes to /tf_static again, so that every latched transform is received again.
    """

    def __init__(self, node: Node, parameters: NodeParameters) -> None:
        self._node = node
        self._invert = parameters.invert_tf
        self._parent, self._child = parameters.odom_frame, parameters.base_frame
        if self._invert:
            self._parent, self._child = self._child, self._parent
        self._type = transform_type()
        transform = TransformStamped(child_frame_id=self._child)
        transform.header.frame_id = self._parent
        self._message = self._type and PreparedMessage(self._type(transforms=[transform]), NUMBERS, COUNT)
        self._publisher: Publisher | None = None
        self._own_gid: bytes | None = None
        self._right = RightOfWay()
        self._conflict: _Conflict | None = None
        self._warned = False
        self._last_stamp: int | None = None
        self._sent: dict[tuple[Any, ...], None] = {}
        self.subscribe_static: Callable[[], None] = lambda: None
        self.reconfigure(parameters, insist=False)

    @property
    def conflict(self) -> str:
        """Log message that names the node that sends our transform in our place; empty when no other node sends it."""
        return self._conflict.text if self._conflict else ''

    @property
    def is_sending(self) -> bool:
        """Whether this node has a publisher on /tf."""
        return self._publisher is not None

    @property
    def gives_way(self) -> bool:
        """Whether our transform is not sent because another node sends one."""
        return self._right.gives_way

    def reconfigure(self, parameters: NodeParameters, insist: bool) -> None:
        """Create or destroy the publisher on /tf according to the parameter ``publish_tf``.

        With `insist` the publisher is created even if another node sends a transform to our child frame.

        If tf2_msgs is not installed, log a warning once and send no transform.
        """
        self._max_jump = parameters.time.max_jump * SECOND
        if not parameters.publish_tf:
            self._destroy_publisher()
            self._right, self._conflict = RightOfWay(), None
        elif self._type is None:
            if not self._warned:
                self._node.get_logger().warning('tf2_msgs is not installed: no transform is sent on /tf; '
                                                'install it, or set publish_tf to false')
            self._warned = True
        elif self._publisher is None and (insist or not self._right.gives_way):
            self._create_publisher()
            if insist:
                self._right.insist(time.monotonic())
                self.subscribe_static()

    def _create_publisher(self) -> None:
        before = self._other_publishers('/tf')
        self._publisher = publisher(self._node, self._type, '/tf', DEPTH)
        name = self._node.get_fully_qualified_name()
        self._own_gid = next((gid for gid, endpoint in self._other_publishers('/tf').items()
                              if gid not in before and full_name(endpoint) == name), None)
        self._conflict = None

    def _destroy_publisher(self) -> None:
        if self._publisher:
            self._node.destroy_publisher(self._publisher)
        self._publisher = self._own_gid = None

    def _other_publishers(self, topic: str) -> dict[bytes, TopicEndpointInfo]:
        """Return gid -> endpoint information of all publishers on `topic` except ours."""
        return {gid: endpoint for gid, endpoint in publishers(self._node, topic).items() if gid != self._own_gid}

    def restart(self) -> None:
        """Send the next transform even if its stamp is not newer: the odometry was reset, or tracking restarted."""
        self._last_stamp = None

    def send(self, state: BaseState) -> None:
        """Send the pose of the base, unless another node may send it or a pose with the same or a newer stamp was sent.

        TF ignores transforms that go back in time. If the stamp is more than ``time.max_jump`` before the last one, the
        last stamp was wrong, and the transform is sent.
        """
        if self._publisher is None or not self._right.may_send(time.monotonic(), self._candidates_before):
            return
        if self._last_stamp is not None and (not state.stamp or 0 <= self._last_stamp - state.stamp <= self._max_jump):
            return
        self._last_stamp = state.stamp
        numbers = transform_numbers(state.pose.inverse() if self._invert else state.pose)
        signature = (self._parent, state.stamp, *numbers.tolist())
        self._sent[signature] = None
        if len(self._sent) > REMEMBERED:
            del self._sent[next(iter(self._sent))]
        self._message.publish(self._publisher, state.stamp, numbers)

    def _candidates_before(self) -> int | None:
        """Count other possible senders of our transform with a lower gid than ours; None without other senders."""
        others = [gid for gid, endpoint in self._other_publishers('/tf').items()
                  if may_send_odometry(self._node, endpoint)]
        return sum(self._own_gid is not None and gid < self._own_gid for gid in others) if others else None

    def on_transform(self, transform: TransformStamped, topic: str) -> None:
        """Stop sending our transform when a transform of another node to our child frame was received."""
        if transform.child_frame_id != self._child or not (self.is_sending or self.gives_way):
            return
        signature = _signature(transform)
        if topic == '/tf' and signature in self._sent:
            # Each own transform is received once: a second one was sent by a node like this one.
            del self._sent[signature]
            return
        self._destroy_publisher()
        self._right.conflict(time.monotonic())
        conflict = self._conflict = self._conflict or _Conflict()
        conflict.parent, conflict.topic, conflict.is_new = transform.header.frame_id, topic, True
        if topic == '/tf_static':
            conflict.static_publishers |= self._other_publishers(topic).keys()
        if not conflict.text:
            self._report(conflict)

    def on_timer(self) -> None:
        """Log which other nodes send our transform; send ours again when they have stopped. Called once a second."""
        if not self.gives_way or self._conflict is None:
            return
        now = time.monotonic()
        self._report(self._conflict)
        if not self._has_static_sender(self._conflict, now) and self._right.take_over(now):
            self._create_publisher()
            self._node.get_logger().info(
                f'no other node has sent a transform to {self._child!r} for {self._right.wait:g} s: '
                f'ours, from {self._parent!r}, is sent again')

    def _has_static_sender(self, conflict: _Conflict, now: float) -> bool:
        """Whether a static transform of another node may still be latched."""
        before = conflict.static_publishers
        left = before & self._other_publishers('/tf_static').keys()
        if left and left != before:
            # Which of them sent the transform is unknown; the listener receives again what the others have latched.
            left = set()
            self._right.conflict(now)
        conflict.static_publishers = left
        return bool(left)

    def _report(self, conflict: _Conflict) -> None:
        """Describe the conflict and log it once, and once more when the names of all other nodes are discovered."""
        is_first = not conflict.text
        self._describe(conflict)
        is_complete = UNNAMED not in conflict.names
        was_incomplete = UNNAMED in conflict.logged_names
        if (is_complete and was_incomplete) or (not conflict.logged_names and (is_complete or not is_first)):
            conflict.logged_names = conflict.names
            self._node.get_logger().error(conflict.text)

    def _describe(self, conflict: _Conflict) -> None:
        """Update `names` and `text` of the conflict if a transform was received or the name of a sender was unknown."""
        is_first = not conflict.text
        names = ''
        if conflict.is_new or UNNAMED in conflict.names:
            names = named(self._other_publishers(conflict.topic).values())
        conflict.is_new = False
        if not names and not is_first:
            return
        conflict.names = names or UNNAMED
        until = ('until that publisher has gone' if conflict.static_publishers
                 else f'until it is silent for {self._right.wait:g} s')
        conflict.text = (
            f'another node sends a transform to {self._child!r} too, from {conflict.parent!r}; publishers on '
            f'{conflict.topic}: {conflict.names}. A frame has one parent: ours, from {self._parent!r}, is not sent '
            f'{until}, or publish_tf is set to true; stop the other node, or set publish_tf to false or invert_tf to '
            'true')


def _signature(transform: TransformStamped) -> tuple[Any, ...]:
    """Values that distinguish our transform from that of another node between the same frames."""
    t, q = transform.transform.translation, transform.transform.rotation
    return transform.header.frame_id, in_nanoseconds(transform.header.stamp), t.x, t.y, t.z, q.x, q.y, q.z, q.w
