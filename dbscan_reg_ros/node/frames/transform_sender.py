# SPDX-License-Identifier: Apache-2.0
"""Our transform on /tf, while nobody else sends one to the same frame."""
import time

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node

from ...core.scan import SECOND
from ...recordings.message_fields import transform_fields
from ..interfaces.endpoints import publisher
from ..interfaces.messages import filled, stamp_from_message
from ..monitoring.graph_checks import SOMEBODY, full_name, may_send_odometry, named, publishers
from .right_of_way import RightOfWay

DEPTH = 100
REMEMBERED = 500
"""Transforms of our own that are known again when they are heard."""


def transform_type():
    """The TFMessage type, or None where tf2_msgs is not installed."""
    try:
        from tf2_msgs.msg import TFMessage
    except ModuleNotFoundError:
        return None
    return TFMessage


class TransformSender:
    """Sends the base's pose on /tf, and gives way to whoever else sends a transform to the same frame.

    Parameters
    ----------
    node : rclpy.node.Node
    parameters : NodeParameters

    Attributes
    ----------
    conflict : str
        Who else sends a transform to our child frame, for which ours is not sent; empty while nobody does.
    hear_static : callable
        Hear again all that is latched on /tf_static.
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
        self._own = None
        self._right = RightOfWay()
        self._other: _Other | None = None
        self._warned = False
        self._last_stamp = None
        self._sent: dict = {}
        self.hear_static = lambda: None
        self.reconfigure(parameters, insist=False)

    @property
    def conflict(self):
        return self._other.text if self._other else ''

    def reconfigure(self, parameters, insist):
        """Announce /tf or withdraw from it, as ``publish_tf`` says; `insist` on it though somebody else sends our transform.

        Without tf2_msgs say so once and send nothing.
        """
        self._jump = parameters.time.max_jump * SECOND
        if not parameters.publish_tf:
            self._withdraw()
            self._right, self._other = RightOfWay(), None
        elif self._type is None:
            if not self._warned:
                self._node.get_logger().warning('tf2_msgs is not installed: no transform is sent on /tf; '
                                                'install it, or set publish_tf to false')
            self._warned = True
        elif self._publisher is None and (insist or not self._right.gives_way):
            self._announce()
            if insist:
                self._right.insist(time.monotonic())
                self.hear_static()

    def _announce(self):
        before = self._announced('/tf')
        self._publisher = publisher(self._node, self._type, '/tf', DEPTH)
        name = self._node.get_fully_qualified_name()
        self._own = next((gid for gid, endpoint in self._announced('/tf').items()
                          if gid not in before and full_name(endpoint) == name), None)
        self._other = None

    def _withdraw(self):
        if self._publisher:
            self._node.destroy_publisher(self._publisher)
        self._publisher = self._own = None

    def _announced(self, topic):
        """Endpoint -> its information, of all others that publish on `topic`."""
        return {gid: endpoint for gid, endpoint in publishers(self._node, topic).items() if gid != self._own}

    @property
    def is_sending(self) -> bool:
        """Whether we announce /tf."""
        return self._publisher is not None

    @property
    def gives_way(self) -> bool:
        """Whether nothing is sent, for somebody else sends."""
        return self._right.gives_way

    def restart(self):
        """Take any stamp next: the odometry was reset, or tracking restarted."""
        self._last_stamp = None

    def send(self, state):
        """Send a `BaseState`, unless somebody else may send one, or its stamp is not newer than the last one's: TF refuses to go
        back in time. After one whose stamp lay far in the future time goes on as before."""
        if self._publisher is None or not self._right.may_send(time.monotonic(), self._first):
            return
        if self._last_stamp is not None and (not state.stamp or 0 <= self._last_stamp - state.stamp <= self._jump):
            return
        self._last_stamp = state.stamp
        transform = filled(self._transform, transform_fields(state, *self._frames, self._invert))
        self._sent[_signature(transform)] = None
        if len(self._sent) > REMEMBERED:
            del self._sent[next(iter(self._sent))]
        self._publisher.publish(self._message)

    def _first(self):
        """How many others that may send our transform go first; None when there are no others."""
        others = [gid for gid, endpoint in self._announced('/tf').items() if may_send_odometry(self._node, endpoint)]
        return sum(self._own is not None and gid < self._own for gid in others) if others else None

    def on_transform(self, transform, topic):
        """Look at a transform that was heard: to one that is not ours but has our child frame give way."""
        if transform.child_frame_id != self._child or not (self.is_sending or self.gives_way):
            return
        signature = _signature(transform)
        if topic == '/tf' and signature in self._sent:
            # It comes back once: a second one is that of a node like this one.
            del self._sent[signature]
            return
        self._withdraw()
        self._right.hear(time.monotonic())
        self._other = self._other or _Other()
        self._other.parent, self._other.topic, self._other.heard = transform.header.frame_id, topic, True
        if topic == '/tf_static':
            self._other.latched |= self._announced(topic).keys()
        if not self._other.text:
            self._name_other()

    def look(self):
        """See who else sends to our child frame, and whether that has gone; once a second."""
        if not self.gives_way:
            return
        now = time.monotonic()
        self._name_other()
        if not self._latched(now) and self._right.take_over(now):
            self._announce()
            self._node.get_logger().info(f'nobody else has sent a transform to {self._child!r} for {self._right.wait:g} s: '
                                         f'ours, from {self._parent!r}, is sent again')

    def _latched(self, now):
        """Whether a static transform of somebody else may still be there."""
        latched = self._other.latched
        left = latched & self._announced('/tf_static').keys()
        if left and left != latched:
            # Which of them it was is not known: what is left is heard again, as whenever one goes.
            left = set()
            self._right.hear(now)
        self._other.latched = left
        return bool(left)

    def _name_other(self):
        """Know who else sends to our child frame, and say so once, and again when all names are known: a newcomer's may be known only
        a moment later."""
        other = self._other
        first = not other.text
        names = named(self._announced(other.topic).values()) if other.heard or SOMEBODY in other.names else ''
        other.heard = False
        if names or first:
            other.names = names or SOMEBODY
            gone = 'until it has gone' if other.latched else f'until it was silent for {self._right.wait:g} s'
            other.text = (
                f'somebody else sends a transform to {self._child!r} too, from {other.parent!r}; on {other.topic} there are: '
                f'{other.names}. A frame has one parent: ours, from {self._parent!r}, is not sent {gone}, or publish_tf is set '
                'to true; stop the other one, or set publish_tf to false or invert_tf to true')
        known = SOMEBODY not in other.names
        if known and SOMEBODY in other.told or not other.told and (known or not first):
            other.told = other.names
            self._node.get_logger().error(other.text)


class _Other:
    """Who else sends a transform to our child frame.

    Attributes
    ----------
    parent, topic : str
        Of the last transform that was heard.
    latched : set of bytes
        Publishers on /tf_static one of which has sent it; empty where it came on /tf.
    heard : bool
        Whether there was a transform since the last look.
    names, text : str
        Of the nodes it may be; what is said of it. Both empty at first.
    told : str
        The names that are in the log; empty where it is not there.
    """

    def __init__(self):
        self.parent = self.topic = ''
        self.latched: set = set()
        self.heard = False
        self.names = self.text = self.told = ''


def _signature(transform):
    """What tells a transform of ours from that of another node between the same frames."""
    t, q = transform.transform.translation, transform.transform.rotation
    return transform.header.frame_id, stamp_from_message(transform.header.stamp), t.x, t.y, q.z, q.w
