"""/tf, without tf2_ros: sending needs tf2_msgs only."""
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from ..message_fields import transform_fields
from .endpoints import publisher
from .events import NO_SUBSCRIPTION_EVENTS
from .messages import filled, stamp_from_message
from .subscriptions import Urgent, taken
from .transform_store import make_store

DEPTH = 100
UNHEARD = 1000
"""So many messages on /tf may wait to be heard."""
REMEMBERED = 500
"""Transforms of our own that are known again when they are heard."""


def transform_type():
    """The TFMessage type, or None where tf2_msgs is not installed."""
    try:
        from tf2_msgs.msg import TFMessage
    except ModuleNotFoundError:
        return None
    return TFMessage


class TransformListener:
    """Hears /tf and /tf_static; needs tf2_msgs.

    Transforms that need not be kept are only heard to know who else sends ours: where nobody else sends any, or we send none,
    there is no subscription to /tf, which would bring back each of our own.

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
        self._store = make_store() if keep else None
        self._moving = self._subscription() if keep else None
        latched = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(transform_type(), '/tf_static', lambda m: self._hear(m, '/tf_static'), latched,
                                 event_callbacks=NO_SUBSCRIPTION_EVENTS)

    def _subscription(self):
        return self._node.create_subscription(transform_type(), '/tf', self._hear_moving, UNHEARD,
                                              callback_group=Urgent(self._is_urgent), event_callbacks=NO_SUBSCRIPTION_EVENTS)

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
        useful = self._sender.is_sending and self._node.count_publishers(self._node.resolve_topic_name('/tf')) > 1
        if useful and not self._moving:
            self._moving = self._subscription()
        elif self._moving and not useful:
            self._node.destroy_subscription(self._moving)
            self._moving = None

    def _hear_moving(self, message):
        self._hear(message, '/tf')

    def _hear(self, message, topic):
        for transform in message.transforms:
            if self._store:
                self._store.add(transform, static=topic == '/tf_static')
            self._on_transform(transform, topic)


class TransformSender:
    """Sends the base's pose on /tf, until somebody else turns out to send it too.

    Parameters
    ----------
    node : rclpy.node.Node
    parameters : NodeParameters

    Attributes
    ----------
    conflict : str
        Who else sends a transform to our child frame; empty while nobody does.
    """

    def __init__(self, node: Node, parameters):
        self._node = node
        self._frames = parameters.odom_frame, parameters.base_frame
        self._invert = parameters.invert_tf
        self._parent, self._child = reversed(self._frames) if self._invert else self._frames
        self._type = transform_type()
        self._transform = TransformStamped()
        self._message = self._type and self._type(transforms=[self._transform])
        self._publisher = None
        self._warned = False
        self._last_stamp = None
        self._sent: dict = {}
        self._other = None
        self.conflict = ''
        self.enable(parameters.publish_tf)

    def enable(self, enabled):
        """Announce /tf, or withdraw from it. Without tf2_msgs say so once and send nothing."""
        if not enabled:
            self._withdraw()
            self._other, self.conflict = None, ''
        elif self._type is None:
            if not self._warned:
                self._node.get_logger().warning('tf2_msgs is not installed: no transform is sent on /tf; '
                                                'install it, or set publish_tf to false')
            self._warned = True
        elif self._publisher is None and not self.conflict:
            self._publisher = publisher(self._node, self._type, '/tf', DEPTH)

    def _withdraw(self):
        if self._publisher:
            self._node.destroy_publisher(self._publisher)
        self._publisher = None

    @property
    def is_sending(self) -> bool:
        """Whether we announce /tf."""
        return self._publisher is not None

    def restart(self):
        """Take any stamp next: the odometry was reset, or tracking restarted."""
        self._last_stamp = None

    def send(self, state):
        """Send a `BaseState`, unless its stamp is not newer than the last one's: TF refuses to go back in time."""
        if self._publisher is None or self._last_stamp is not None and state.stamp <= self._last_stamp:
            return
        self._last_stamp = state.stamp
        transform = filled(self._transform, transform_fields(state, *self._frames, self._invert))
        self._sent[_signature(transform)] = None
        if len(self._sent) > REMEMBERED:
            del self._sent[next(iter(self._sent))]
        self._publisher.publish(self._message)

    def on_transform(self, transform, topic):
        """Look at a transform that was heard: when it is not ours but has our child frame, send no more."""
        if (transform.child_frame_id != self._child or self._publisher is None
                or topic == '/tf' and _signature(transform) in self._sent):
            return
        self._withdraw()
        self._other = transform.header.frame_id, topic
        self.look_at_conflict()

    def look_at_conflict(self):
        """Say once who else sends to our child frame; a newcomer's name may be known only a moment later."""
        if self._other is None:
            return
        parent, topic = self._other
        nodes = sorted({f'{e.node_namespace.rstrip("/")}/{e.node_name}'
                        for e in self._node.get_publishers_info_by_topic(topic) if not e.node_name.startswith('_')}
                       - {self._node.get_fully_qualified_name()})
        first, self.conflict = not self.conflict, (
            f'somebody else sends a transform to {self._child!r} too, from {parent!r}; on {topic} there are: '
            f'{", ".join(nodes) or "nodes without a name"}. A frame has one parent: ours, from {self._parent!r}, is sent no '
            'more. Stop the other one and set publish_tf to false and to true again, or set invert_tf to true')
        if nodes or not first:
            self._other = None
            self._node.get_logger().error(self.conflict)


def _signature(transform):
    """What tells a transform of ours from that of another node between the same frames."""
    t, q = transform.transform.translation, transform.transform.rotation
    return transform.header.frame_id, stamp_from_message(transform.header.stamp), t.x, t.y, q.z, q.w
