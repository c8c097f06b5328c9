"""/tf without tf2_ros: the message type is imported where it is used, for it may be missing."""
from rclpy.node import Node

from .messages import transform_to_message

DEPTH = 100


def transform_type():
    """The TFMessage type, or None where tf2_msgs is not installed."""
    try:
        from tf2_msgs.msg import TFMessage
    except ModuleNotFoundError:
        return None
    return TFMessage


class TransformSender:
    """Sends the base's pose on /tf.

    Parameters
    ----------
    node : rclpy.node.Node
    """

    def __init__(self, node: Node):
        self._node = node
        self._type = transform_type()
        self._publisher = None
        self._warned = False
        self._last_stamp = None

    def enable(self, enabled):
        """Announce /tf, or withdraw from it. Without tf2_msgs say so once and send nothing."""
        if not enabled:
            if self._publisher:
                self._node.destroy_publisher(self._publisher)
            self._publisher = None
        elif self._type is None:
            if not self._warned:
                self._node.get_logger().warning('tf2_msgs is not installed: no transform is sent on /tf; '
                                                'install it, or set publish_tf to false')
            self._warned = True
        elif self._publisher is None:
            self._publisher = self._node.create_publisher(self._type, '/tf', DEPTH)

    def restart(self):
        """Take any stamp next: time has started anew."""
        self._last_stamp = None

    def send(self, state, odom_frame, base_frame):
        """Send a `BaseState`, unless its stamp is not newer than the last one's: TF refuses to go back in time."""
        if self._publisher is None or self._last_stamp is not None and state.stamp <= self._last_stamp:
            return
        self._last_stamp = state.stamp
        self._publisher.publish(self._type(transforms=[transform_to_message(state, odom_frame, base_frame)]))
