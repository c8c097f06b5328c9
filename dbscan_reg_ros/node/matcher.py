"""What the node does, whatever kind of node it is."""
from nav_msgs.msg import Odometry as OdometryMessage
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import LaserScan
from visualization_msgs.msg import MarkerArray

from ..core.errors import DbscanRegError
from ..core.odometry import Odometry
from ..core.records import Status
from ..core.scan import Scan
from .live_parameters import LiveParameters
from .messages import angles_disagree, odometry_to_message, segments_to_message
from .mounting import base_state
from .mountings import Mountings
from .notices import Notices
from .transforms import TransformSender

ODOM_DEPTH = 50
SEGMENTS_DEPTH = 5


class ScanMatcher:
    """Laser odometry on a node: subscribes to ``scan``, publishes ``odom``, ``segments`` and ``/tf``.

    All callbacks run one after the other, so that a change of parameters falls between two scans.

    Parameters
    ----------
    node : rclpy.node.Node
        Made with ``automatically_declare_parameters_from_overrides=True``.

    Raises
    ------
    ParameterError
        When a parameter has a wrong value.
    """

    def __init__(self, node: Node):
        self._node = node
        self._live = LiveParameters(node, self._reconfigure)
        self._odometry = Odometry(self._live.value)
        self._mountings = Mountings(node, self._live.value)
        self._transforms = TransformSender(node)
        self._notices = Notices(node.get_logger())
        self._geometry = None
        self._origin = None

    def start(self):
        """Begin to publish, then to listen."""
        node = self._node
        self._odom = node.create_publisher(OdometryMessage, 'odom', ODOM_DEPTH)
        self._segments = node.create_publisher(MarkerArray, 'segments', SEGMENTS_DEPTH)
        self._transforms.enable(self._live.value.publish_tf)
        self._scans = node.create_subscription(LaserScan, 'scan', self._on_scan, qos_profile_sensor_data)
        node.get_logger().info(f'ready: {self._scans.topic_name} -> {self._odom.topic_name}')

    def _reconfigure(self, parameters):
        self._odometry.parameters = parameters
        self._transforms.enable(parameters.publish_tf)

    def _on_scan(self, message):
        try:
            mounting = self._mountings.find(message.header.frame_id)
            scan = Scan.from_message(message, self._geometry, mounting.upside_down)
            if scan.geometry is not self._geometry:
                self._look_at_geometry(message, scan.geometry)
            update = self._odometry.process(scan)
        except DbscanRegError as error:
            self._notices.warn(f'scan skipped: {error}')
            return
        if self._origin is None:
            self._origin = mounting.pose
        self._report(update)
        self._publish(update, mounting)

    def _look_at_geometry(self, message, geometry):
        """Say what is odd about the beams when they are not those of the last scan."""
        if self._geometry is not None and geometry.size != self._geometry.size:
            self._notices.warn(f'the scans change from {self._geometry.size} to {geometry.size} beams')
        disagreement = angles_disagree(message)
        if disagreement:
            self._notices.warn(disagreement)
        self._geometry = geometry

    def _report(self, update):
        if update.restarted:
            self._transforms.restart()
            self._notices.warn(f'odometry started anew: {update.restarted}')
        elif update.status is Status.FAILED:
            self._notices.warn(f'scan could not be registered: {update.registration.reason}')

    def _publish(self, update, mounting):
        parameters = self._live.value
        frames = parameters.odom_frame, parameters.base_frame
        state = base_state(update, self._origin, mounting.pose)
        self._odom.publish(odometry_to_message(state, *frames))
        self._transforms.send(state, *frames)
        if self._segments.get_subscription_count():
            self._segments.publish(segments_to_message(update, self._origin, parameters.odom_frame))
