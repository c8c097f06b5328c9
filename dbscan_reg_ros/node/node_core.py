# SPDX-License-Identifier: Apache-2.0
"""Node core: laser odometry on any rclpy node, plain or lifecycle."""
import time
from collections.abc import Collection
from contextlib import suppress
from typing import TYPE_CHECKING

from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.timer import Timer

from ..core.errors import DbscanRegError
from ..core.geometry.mounting import Mounting
from ..core.geometry.se2 import SE2
from ..core.odometry.pipeline import Odometry
from ..core.odometry.records import OdometryUpdate
from ..core.registration.records import Status
from ..core.scan import SECOND, in_nanoseconds
from ..robot.base_state import BaseState, InitialPose, base_state, predicted_state
from ..robot.parameters import NodeParameters
from ..robot.scan_buffer import ScanBuffer
from .frames.mountings import Mountings
from .frames.transform_sender import TransformSender
from .frames.transforms import TransformListener
from .interfaces.endpoints import GraphEntities
from .interfaces.lidar import Callbacks, Lidar, OdometryTrigger
from .interfaces.live_parameters import LiveParameters
from .interfaces.outputs import Outputs
from .interfaces.scan_reader import ScanMessage
from .interfaces.services import Services
from .interfaces.topics import TF
from .monitoring.diagnostics import PERIOD, Diagnostics
from .priors import Priors
from .state_file import StateFile
from .throttled_log import ThrottledLog

if TYPE_CHECKING:
    from .map.robot_in_map import RobotInMap

MOST_FRAMES = 8
"""Largest number of lidars on one topic."""


class NodeCore:
    """Laser odometry on a `node`, plain or lifecycle: subscribes to ``scan``, publishes ``odom``, ``/tf`` and more.

    All callbacks run one after the other, so the `live` parameters never change while a scan is processed. Raises a
    ParameterError when a parameter needs a package that is not installed, sets an invalid quality of service, or names
    a map that cannot be read.
    """

    def __init__(self, node: Node, live: LiveParameters) -> None:
        parameters = live.value
        lidars = [parameters.lidar(topic) for topic in parameters.scan_topics]
        self._node = node
        self._live = live
        self._entities = GraphEntities(node)
        self._odometry = Odometry(parameters.for_odometry())
        self._log = ThrottledLog(node.get_logger())
        self._sender = TransformSender(node, parameters)
        self._listener = TransformListener(
            node, self._on_transform,
            any(lidar.mounting == 'tf' for lidar in lidars) or parameters.prior.source == 'tf'
            or parameters.map.mode != 'none', self._has_pending, self._sender
        ) if TF.kind else None
        self._priors = Priors(node, parameters, self._listener, self._log, self._retry_pending)
        self._lidars = [Lidar(lidar.topic, len(lidars) > 1, node,
                              Mountings(parameters.base_frame, lidar, self._listener), rank)
                        for rank, lidar in enumerate(lidars)]
        self._callbacks = Callbacks(self._patience, self._on_scan, self._retry_others, self._lidar_of, ScanBuffer())
        self._trigger = OdometryTrigger(len(lidars), parameters.odom_on == 'all')
        self._outputs = Outputs(node, parameters)
        self._in_map = self._make_in_map(parameters)
        self._services = Services(node, parameters, self._log, self._reset)
        self._diagnostics = Diagnostics(node, self._lidars, self._priors, self._log, self._sender,
                                        self._outputs.odom, lambda: self._services.paused,
                                        self._in_map.diagnosis if self._in_map else None)
        self._jumps = node.get_clock().create_jump_callback(
            JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=True),
            post_callback=self._on_time_jump)
        node.create_timer(PERIOD, self._on_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._state_file = StateFile(node, parameters)
        self._initial = self._state_file.load() or self._at_start()
        node.context.on_shutdown(self._write_state)
        self._origin: SE2 | None = None
        self._between: Timer | None = None
        self._predicted_from: BaseState | None = None
        self._last: tuple[Lidar, ScanMessage, BaseState] | None = None
        self._reconfigure(parameters)
        live.changed = self._reconfigure

    def _at_start(self) -> InitialPose:
        """Return the pose of the base at the first scan."""
        return InitialPose(SE2.from_array(self._live.value.initial_pose))

    def _make_in_map(self, parameters: NodeParameters) -> 'RobotInMap | None':
        """Make what localises or maps; without it nothing of that is imported."""
        if parameters.map.mode == 'none':
            if parameters.map.file:
                self._node.get_logger().warning(f'map.file = {parameters.map.file!r} has no effect: map.mode is none; '
                                                'set it to localize or slam')
            return None
        from .map.robot_in_map import RobotInMap
        return RobotInMap(self._node, parameters, self._log, self._listener, self._sender)

    def activate(self) -> None:
        """Subscribe to the scans of all lidars; raise a ParameterError if a QoS parameter is invalid."""
        inboxes = [lidar.subscribe(self._callbacks) for lidar in self._lidars]
        self._diagnostics.restart()
        topics = ', '.join(inbox.name for inbox in inboxes)
        self._node.get_logger().info(f'ready: {topics} -> {self._outputs.odom.topic_name}')

    def deactivate(self) -> None:
        """Unsubscribe from the scans; the pose and the map are kept."""
        for lidar in self._lidars:
            lidar.unsubscribe()
        self._diagnostics.restart()

    def close(self) -> None:
        """Destroy the publishers, subscriptions, services and timers created on the node, but keep its parameters."""
        self._live.changed = None
        self._write_state()
        self._jumps.unregister()
        if self._in_map:
            self._in_map.close()
        self._entities.destroy()

    def _write_state(self) -> None:
        """Write the last state of the base to ``state_file``."""
        if self._last:
            self._state_file.write(self._last[2])

    def _reconfigure(self, parameters: NodeParameters, names: Collection[str] = ()) -> None:
        """Apply `parameters`; `names` are the parameters that were just set, even to their old values."""
        self._odometry.parameters = parameters.for_odometry()
        for part in (self._priors, self._outputs, self._services, self._in_map):
            if part:
                part.parameters = parameters
        if 'input.time_offset' in names:
            self._odometry.comparisons.lidars.clear()
        for lidar in self._lidars:
            lidar.reconfigure(parameters)
        self._sender.reconfigure(parameters, insist='publish_tf' in names)
        if self._between:
            self._node.destroy_timer(self._between)
        rate = parameters.publish_rate
        self._between = self._node.create_timer(1.0 / rate, self._publish_between) if rate else None

    def _patience(self, lidar: Lidar, message: ScanMessage) -> float:
        """Return how long [s] after its arrival a scan may wait.

        It waits while its mounting or prior is not known yet, or an older scan of another lidar has come or is due.
        """
        frame, stamp, given = message.header.frame_id, in_nanoseconds(message.header.stamp), lidar.input
        if not (lidar.mountings.ready(frame, stamp) and self._priors.ready(self._followed_frame(frame), stamp)):
            return max(given.max_wait, given.reorder)
        others = [other.inbox for other in self._lidars if other is not lidar and other.inbox]
        for inbox in others:
            if lidar.inbox and inbox.source is not lidar.inbox.source:
                inbox.source.take(lidar.inbox)
        return given.reorder if lidar.inbox and lidar.inbox.must_wait(stamp) else 0.0

    def _followed_frame(self, frame: str) -> str:
        """Name of the frame that the odometry tracks: that of the only lidar, or with several lidars the base frame."""
        return frame if len(self._lidars) == 1 else self._live.value.base_frame

    def _lidar_of(self, lidar: Lidar, frame: str) -> Lidar:
        """Return a new lidar for the scans in another `frame` on the topic of `lidar`, if mountings are transforms.

        Otherwise, and for more than `MOST_FRAMES` frames, return `lidar`, which warns of the changing frame.
        """
        value = self._live.value
        parameters = value.lidar(lidar.topic)
        if parameters.mounting != 'tf' or len(lidar.frames) >= MOST_FRAMES:
            return lidar
        lidar.distinguish(True, next(iter(lidar.frames)))
        mountings = Mountings(value.base_frame, parameters, self._listener)
        further = lidar.frames[frame] = Lidar(lidar.topic, True, self._node, mountings, len(self._lidars), lidar)
        self._lidars.append(further)
        if further.rank == 1:
            self._restart_at_last_scan()
        self._trigger.add_lidar()
        self._outputs.lidars = len(self._lidars)
        further.reconfigure(value)
        further.distinguish(True, frame)
        further.subscribe(self._callbacks)
        self._node.get_logger().info(f'{further.label}another lidar on this topic: each frame is a lidar of its own '
                                     f'({", ".join(lidar.frames)})')
        return further

    def _restart_at_last_scan(self) -> None:
        """Start again at the last scan and the last pose of the base, with other lidars or mountings."""
        if self._last is None:
            return
        lidar, message, state, mounting = *self._last, Mounting()
        self._odometry.reset()
        self._odometry.comparisons.lidars.clear()
        self._initial, self._origin = InitialPose(state.pose, state.covariance), None
        # Without its transform, which may have gone, the next scan starts at that pose.
        with suppress(DbscanRegError):
            scan, mounting, _ = lidar.read(message)
            self._odometry.process(scan, None, lidar.sensor(mounting))
        self._priors.processed(state.stamp, mounting if len(self._lidars) == 1 else Mounting())

    def _on_scan(self, lidar: Lidar, message: ScanMessage) -> None:
        if self._services.paused:
            return
        lidar.counters.add_warnings(lidar.reader.check(message, bool(lidar.competition)))
        due, wrong = lidar.stamps.update(message, self._live.value.time.max_jump)
        if wrong:
            lidar.skip(lidar.competition or 'its stamp lies far before those of the scans around it')
        for scan in due:
            self._process(lidar, scan)

    def _process(self, lidar: Lidar, message: ScanMessage) -> None:
        began = time.perf_counter()
        try:
            scan, mounting, sent_again = lidar.read(message)
            if sent_again:
                self._restart_at_last_scan()
            if lidar.stamps.has_restarted(scan.stamp, self._live.value.time.max_jump):
                self._on_stamps_restart(lidar)
            followed = mounting if len(self._lidars) == 1 else Mounting()
            frame = self._followed_frame(scan.frame_id)
            prior = self._priors.find(frame, scan.stamp, followed, self._odometry.predict_motion)
            update = self._odometry.process(scan, prior, lidar.sensor(mounting))
        except DbscanRegError as error:
            lidar.skip(str(error))
            return
        if self._origin is None:
            self._origin = self._initial.pose @ followed.aligned_pose
        lidar.stamps.used(scan.stamp)
        if not update.waits:
            self._priors.processed(scan.stamp, followed)
        self._services.keep(update, prior)
        lidar.counters.cause = lidar.competition
        self._log_tracking(lidar, update)
        state = base_state(update, self._origin, followed.aligned_pose, self._initial)
        if self._listener:
            self._listener.poll()
        if not (update.repeats or (lidar.rank and update.waits)) and self._trigger.is_due(lidar.rank, scan.stamp):
            self._sender.send(state)
            self._outputs.publish(update, state, self._origin)
        else:
            self._outputs.keep(update)
        if self._in_map:
            self._in_map.process(update, state, self._origin, followed.aligned_pose)
        self._last = lidar, message, state
        lidar.counters.compared = self._odometry.comparisons.lidars.get(lidar.sensor_name)
        lidar.counters.mounting = mounting
        lidar.counters.body.add(scan, update.pose @ update.sensor.pose)
        lidar.counters.processed_scan(update, self._origin, followed.aligned_pose, time.perf_counter() - began)

    def _publish_between(self) -> None:
        """Publish transform and ``odom`` between two scans, as predicted from the last one."""
        if self._last is None or self._services.paused:
            return
        state, now = self._last[2], self._node.get_clock().now().nanoseconds
        if 0 < now - state.stamp <= self._live.value.odometry.coast_time * SECOND:
            predicted = predicted_state(state, now, self._odometry.parameters)
            self._sender.send_predicted(predicted)
            self._outputs.publish_predicted(predicted)
        elif state is not self._predicted_from:
            age = (now - state.stamp) / SECOND
            self._log.warn(f'publish_rate has no effect: the last scan is {age:.3f} s older than the clock of the '
                           'node, expected from 0 to advanced.odometry.coast_time; a recording needs use_sim_time')
        self._predicted_from = state

    def _on_stamps_restart(self, lidar: Lidar) -> None:
        """Reset the odometry; if scans of an earlier lidar are received, only the driver of this one has restarted."""
        if self._trigger.leads(lidar.rank):
            self._reset(f'{lidar.label}{lidar.competition or "the stamps of the scans start again"}')
        else:
            lidar.stamps.restart()

    def _log_tracking(self, lidar: Lidar, update: OdometryUpdate) -> None:
        """Log a restart of the tracking, a failed registration, and what a scan has shown about its `lidar`."""
        if update.finding:
            lidar.log.warn(update.finding)
        if update.restarted and update.registration is None:
            self._sender.restart()
            lidar.log.warn(f'tracking restarted at the last pose: {update.restarted}')
        elif update.restarted:
            lidar.log.warn(update.restarted)
        elif update.status is Status.FAILED and update.registration:
            lidar.log.warn(f'scan could not be registered: {lidar.counters.cause or update.registration.reason}')
        elif update.contradicted:
            lidar.log.warn(update.contradiction)

    def _reset(self, reason: str, initial: InitialPose | None = None) -> None:
        """Restart the odometry at the next scan, at which the base has the pose `initial`, or ``initial_pose``."""
        self._node.get_logger().info(f'odometry reset: {reason}')
        self._initial = initial or self._at_start()
        self._origin = self._last = None
        self._odometry.reset()
        self._outputs.reset()
        for part in (self._priors, self._trigger, self._sender):
            part.restart()
        if self._in_map:
            self._in_map.restart()
        for lidar in self._lidars:
            lidar.stamps.restart()
            lidar.counters.body.restart()

    def _on_timer(self) -> None:
        """Timer callback, called once a `PERIOD` whether or not scans arrive."""
        if self._listener:
            self._listener.on_timer()
        self._sender.on_timer()
        self._outputs.publish_pictures()
        self._outputs.publish_grid()
        if self._in_map:
            self._in_map.on_timer()
        if self._last:
            self._state_file.keep(self._last[2])
        adopted = [lidar.adopt_type() for lidar in self._lidars]
        if any(adopted):
            self._diagnostics.restart()
        self._diagnostics.publish()

    def _has_pending(self) -> bool:
        return any(lidar.inbox is not None and lidar.inbox.has_pending() for lidar in self._lidars)

    def _retry_pending(self) -> None:
        for lidar in self._lidars:
            if lidar.inbox:
                lidar.inbox.retry_pending()

    def _retry_others(self, lidar: Lidar) -> None:
        """Retry the scans that may have waited for one of `lidar`."""
        for other in self._lidars:
            if other is not lidar and other.inbox:
                other.inbox.retry_pending()

    def _on_transform(self, transform: TransformStamped, topic: str) -> None:
        self._sender.on_transform(transform, topic)
        if self._in_map:
            self._in_map.on_transform(transform)
        self._retry_pending()

    def _on_time_jump(self, jump: TimeJump) -> None:
        """Reset the odometry when the clock jumps back by more than ``time.max_jump``, as in a looped bag."""
        if jump.delta.nanoseconds >= -self._live.value.time.max_jump * SECOND:
            return
        if self._listener:
            self._listener.restart()
        held = [lidar.stamps.held for lidar in self._lidars]
        self._reset(f'the clock went back by {-jump.delta.nanoseconds * 1e-9:.1f} s')
        for lidar, message in zip(self._lidars, held, strict=True):
            lidar.reader.restart()
            # The first scan of a recording that starts again may come before its clock.
            lidar.stamps.held = message
