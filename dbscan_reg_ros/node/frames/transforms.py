# SPDX-License-Identifier: Apache-2.0
"""What is heard on /tf and /tf_static."""
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from ..interfaces.no_qos_events import NO_SUBSCRIPTION_EVENTS
from ..interfaces.subscriptions import Urgent, taken
from ..monitoring.graph_checks import publishers
from .transform_sender import transform_type
from .transform_store import make_store

DEPTH = 100
UNHEARD = 1000
"""So many messages on /tf may wait to be heard."""


class TransformListener:
    """Hears /tf and /tf_static; needs tf2_msgs.

    Transforms that need not be kept are only heard to know who else sends ours: where nobody else sends any, or ours is not
    asked for, there is no subscription to /tf, which would bring back each of our own.

    Parameters
    ----------
    node : rclpy.node.Node
    on_transform : callable
        Called with each TransformStamped and its topic.
    keep : bool
        Keep the transforms for `lookup`.
    is_urgent : callable
        Whether to hear /tf as soon as there is something, and not only before a `lookup` and in `hear`.
    sender : TransformSender
        Who sends ours.
    """

    def __init__(self, node: Node, on_transform, keep, is_urgent, sender):
        self._node = node
        self._on_transform = on_transform
        self._is_urgent = is_urgent
        self._sender = sender
        self._topic = node.resolve_topic_name('/tf')
        self._store = make_store() if keep else None
        self._moving = self._subscription() if keep else None
        self._static = None
        self._latched: set = set()
        self.hear_static()
        sender.hear_static = self.hear_static

    def _subscription(self):
        return self._node.create_subscription(transform_type(), '/tf', self._hear_moving, UNHEARD,
                                              callback_group=Urgent(self._is_urgent), event_callbacks=NO_SUBSCRIPTION_EVENTS)

    def hear_static(self):
        """Hear all that is latched on /tf_static, again if need be."""
        if self._static:
            self._node.destroy_subscription(self._static)
        latched = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._static = self._node.create_subscription(transform_type(), '/tf_static', self._hear_latched, latched,
                                                      event_callbacks=NO_SUBSCRIPTION_EVENTS)

    def look(self):
        """Hear what has come on /tf; once a second.

        When a publisher on /tf_static has gone, hear again what is left: it counts before what the other has said of its frames.
        """
        self.hear()
        latched = publishers(self._node, '/tf_static').keys()
        if self._latched - latched:
            self.hear_static()
        self._latched = set(latched)

    def lookup(self, target, source, stamp):
        """As `TransformStore.lookup`."""
        self.hear()
        return self._store.lookup(target, source, stamp)

    def restart(self):
        """Forget what moves: time has gone back."""
        self.hear()
        if self._store:
            self._store.clear()

    def hear(self):
        """Hear what has come on /tf."""
        if self._moving:
            for message in taken(self._moving):
                self._hear_moving(message)
        if self._store:
            return
        useful = self._sender.gives_way or self._sender.is_sending and self._node.count_publishers(self._topic) > 1
        if useful and not self._moving:
            self._moving = self._subscription()
        elif self._moving and not useful:
            self._node.destroy_subscription(self._moving)
            self._moving = None

    def _hear_moving(self, message):
        self._hear(message, '/tf')

    def _hear_latched(self, message):
        self._latched |= publishers(self._node, '/tf_static').keys()
        self._hear(message, '/tf_static')

    def _hear(self, message, topic):
        for transform in message.transforms:
            if self._store:
                self._store.add(transform, static=topic == '/tf_static')
            self._on_transform(transform, topic)
