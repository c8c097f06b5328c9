"""/tf without tf2_ros: the message type is imported where it is used, for it may be missing."""
import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from .messages import matrix_from_message, transform_to_message
from .mounting import MountingError

DEPTH = 100
MAX_CHAIN = 100


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


class StaticTransforms:
    """The transforms on /tf_static, composed along their tree.

    Parameters
    ----------
    node : rclpy.node.Node
    """

    def __init__(self, node: Node):
        self._parents = {}
        quality = QoSProfile(depth=DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._subscription = node.create_subscription(transform_type(), '/tf_static', self._on_transforms, quality)

    def _on_transforms(self, message):
        for transform in message.transforms:
            matrix = matrix_from_message(transform.transform)
            if matrix is not None:
                self._parents[transform.child_frame_id] = transform.header.frame_id, matrix

    def lookup(self, target, source):
        """The matrix ``(4, 4)`` that takes points in `source` to `target`.

        Raises
        ------
        MountingError
            When the two frames are not connected.
        """
        source_root, from_source = self._to_root(source)
        target_root, from_target = self._to_root(target)
        if source_root != target_root:
            raise MountingError(f'no transform from {target!r} to {source!r} on /tf_static: no odometry before it is '
                                'there; publish it, or set mounting to laser_pose or none')
        return np.linalg.inv(from_target) @ from_source

    def _to_root(self, frame):
        """(topmost frame above `frame`, matrix that takes points to it)."""
        matrix = np.eye(4)
        for _ in range(MAX_CHAIN):
            if frame not in self._parents:
                break
            frame, step = self._parents[frame]
            matrix = step @ matrix
        return frame, matrix
