# SPDX-License-Identifier: Apache-2.0
"""What the node does, whatever kind of node it is."""
import time

from rclpy.clock import Clock, ClockType, JumpThreshold
from rclpy.duration import Duration
from rclpy.node import Node

from ..core.errors import DbscanRegError
from ..core.odometry.pipeline import Odometry
from ..core.registration.records import Status
from ..core.scan import SECOND
from ..robot.base_state import InitialPose, base_state
from .frames.mountings import Mountings
from .frames.transform_sender import TransformSender, transform_type
from .frames.transforms import TransformListener
from .interfaces.graph_entities import Entities
from .interfaces.live_parameters import LiveParameters
from .interfaces.messages import stamp_from_message
from .interfaces.outputs import Outputs
from .interfaces.priors import Priors
from .interfaces.scan_input import ScanInbox, ScanReader, Stamps
from .interfaces.services import Services
from .monitoring.counters import Health
from .monitoring.diagnostics import PERIOD, Diagnostics
from .monitoring.throttled_log import Notices


class ScanMatcher:
    """Laser odometry on a node: subscribes to ``scan``, publishes ``odom``, ``/tf`` and more.

    All callbacks run one after the other, so that a change of parameters falls between two scans.

    Parameters
    ----------
    node : rclpy.node.Node
    live : LiveParameters
        Of that node.

    Raises
    ------
    ParameterError
        When what the parameters ask for is not installed or does not exist.
    """

    def __init__(self, node: Node, live: LiveParameters):
        parameters = live.value
        self._node = node
        self._live = live
        self._entities = Entities(node)
        self._odometry = Odometry(parameters.for_odometry())
        self._notices = Notices(node.get_logger())
        self._health = Health()
        self._inbox = None
        self._sender = TransformSender(node, parameters)
        self._listener = TransformListener(
            node, self._on_transform, 'tf' in (parameters.mounting, parameters.prior.source), self._is_waiting, self._sender
        ) if transform_type() else None
        self._mountings = Mountings(parameters, self._listener, self._notices)
        self._priors = Priors(node, parameters, self._listener, self._notices, self._look_again)
        self._reader = ScanReader(node.get_clock(), self._notices)
        self._stamps = Stamps()
        self._outputs = Outputs(node, parameters)
        self._services = Services(node, parameters, self._notices, self._reset)
        self._diagnostics = Diagnostics(node, self._health, self._notices, self._sender, self._outputs.odom,
                                        lambda: self._services.paused)
        self._jumps = node.get_clock().create_jump_callback(
            JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True),
            post_callback=self._on_time_jump)
        node.create_timer(PERIOD, self._look_round, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._start = InitialPose()
        self._origin = None
        self._reconfigure(parameters)
        live.changed = self._reconfigure

    def activate(self):
        """Begin to listen; ParameterError as of `ScanInbox`."""
        self._inbox = ScanInbox(self._node, self._live.value, self._ready, self._on_scan)
        self._diagnostics.watch(self._inbox)
        self._node.get_logger().info(f'ready: {self._inbox.topic} -> {self._outputs.odom.topic_name}')

    def deactivate(self):
        """Listen no more; what is known is kept."""
        self._diagnostics.watch(None)
        self._inbox.close()
        self._inbox = None

    def close(self):
        """Leave nothing behind on the node but its parameters."""
        self._live.changed = None
        self._jumps.unregister()
        self._entities.destroy()

    def _reconfigure(self, parameters, names=()):
        """Go by `parameters`, of which those named were set just now, be it to what they were."""
        self._odometry.parameters = parameters.for_odometry()
        for part in (self._priors, self._outputs, self._services, self._inbox):
            if part:
                part.parameters = parameters
        self._sender.reconfigure(parameters, insist='publish_tf' in names)

    def _ready(self, message):
        """Whether a scan need not wait for what else is to be known of its time."""
        frame, stamp = message.header.frame_id, stamp_from_message(message.header.stamp)
        return self._mountings.ready(frame, stamp) and self._priors.ready(frame, stamp)

    def _on_scan(self, message):
        if self._services.paused:
            return
        self._health.doubt(self._reader.look(message))
        due, wrong = self._stamps.update(message, self._live.value.time.max_jump)
        if wrong:
            self._skip('its stamp lies far before those of the scans around it')
        for scan in due:
            self._use(scan)

    def _skip(self, reason):
        self._notices.warn(f'scan skipped: {reason}')
        self._health.skip(reason)

    def _use(self, message):
        began = time.perf_counter()
        try:
            mounting = self._mountings.find(message.header.frame_id, stamp_from_message(message.header.stamp))
            scan = self._reader.read(message, mounting, self._live.value)
            if self._stamps.start_again(scan.stamp, self._live.value.time.max_jump):
                self._reset('the stamps of the scans start again', InitialPose())
            prior = self._priors.find(scan.frame_id, scan.stamp, mounting, self._odometry.predict_motion)
            update = self._odometry.process(scan, prior)
        except DbscanRegError as error:
            self._skip(str(error))
            return
        if self._origin is None:
            self._origin = self._start.pose @ mounting.aligned_pose
        self._stamps.used(scan.stamp)
        self._priors.processed(scan.stamp, mounting)
        self._services.keep(update, prior)
        self._report(update)
        state = base_state(update, self._origin, mounting.aligned_pose, self._start)
        if self._listener:
            self._listener.hear()
        self._sender.send(state)
        self._outputs.publish(update, state, self._origin)
        self._health.processed(update, self._origin, mounting.aligned_pose, time.perf_counter() - began)

    def _report(self, update):
        if update.restarted and update.registration is None:
            self._sender.restart()
            self._notices.warn(f'tracking restarted at the last pose: {update.restarted}')
        elif update.restarted:
            self._notices.warn(update.restarted)
        elif update.status is Status.FAILED:
            self._notices.warn(f'scan could not be registered: {update.registration.reason}')

    def _reset(self, reason, start):
        """Take the next scan as the first one, with the base at `start`."""
        self._node.get_logger().info(f'odometry reset: {reason}')
        self._start = start
        self._origin = None
        for part in (self._odometry, self._outputs):
            part.reset()
        for part in (self._priors, self._stamps, self._sender):
            part.restart()

    def _look_round(self):
        """What is done once in a `PERIOD`, whether there are scans or not."""
        if self._listener:
            self._listener.look()
        self._sender.look()
        self._outputs.publish_pictures()
        self._diagnostics.publish()

    def _is_waiting(self):
        return self._inbox is not None and self._inbox.is_waiting()

    def _look_again(self):
        if self._inbox:
            self._inbox.look_again()

    def _on_transform(self, transform, topic):
        self._sender.on_transform(transform, topic)
        self._look_again()

    def _on_time_jump(self, jump):
        """Reset when the clock goes back, as it does when a bag is played in a loop; a little back is jitter."""
        if jump.delta.nanoseconds >= -self._live.value.time.max_jump * SECOND:
            return
        if self._listener:
            self._listener.restart()
        self._reader.restart()
        held = self._stamps.held
        self._reset(f'the clock went back by {-jump.delta.nanoseconds * 1e-9:.1f} s', InitialPose())
        # The first scan of a recording that starts again may come before its clock.
        self._stamps.held = held
