# SPDX-License-Identifier: Apache-2.0
"""The robot in a map: topics, services and the transform from the frame of the map to that of the odometry."""
import dataclasses
import time
from collections import deque
from concurrent.futures import Future

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import OccupancyGrid
from rclpy.node import Node
from rclpy.task import Future as Answer
from std_msgs.msg import String
from std_srvs.srv import Empty, Trigger

from ...core.errors import ParameterError
from ...core.geometry.se2 import SE2, turned
from ...core.odometry.records import OdometryUpdate
from ...core.registration.records import sigma_text
from ...core.scan import SECOND, in_nanoseconds
from ...paths import expanded
from ...places.grid import Grid
from ...places.localizer import State
from ...places.map import MapError
from ...places.map_files import load_grid
from ...recordings.message_fields import transform_numbers
from ...robot.base_state import BaseState
from ...robot.parameters import NodeParameters
from ..frames.transform_sender import WAIT, TransformSender, prepared_transform
from ..frames.transforms import TransformListener
from ..interfaces import topics
from ..interfaces.endpoints import publisher, subscription
from ..interfaces.messages import PoseError, initial_pose
from ..throttled_log import ThrottledLog
from .messages import graph_to_message, grid_from_message, grid_to_message, pose_with_covariance
from .tracking import WAITING as SCANS_LEFT_OUT
from .tracking import Found, Picture, Tracking

SENT = 500
"""Number of our latest transforms that are recognised when they are received."""
WAITING = 20
"""Largest number of scans that wait for a transform of the odometry at their stamps."""
PATIENCE = 5.0
"""Time [s] after which the lack of a map is said."""
DRAWN_EVERY, DRAWN_SHARE = 2.0, 0.1
"""Least interval [s] between two pictures of a map that is built, and largest share of the time that they take."""


class RobotInMap:
    """Localises the robot in a map, or builds one, and sends the transform from ``map.frame`` to ``odom_frame``.

    Parameters
    ----------
    node : rclpy.node.Node
        The node that publishes.
    parameters : NodeParameters
        Parameters of the node; may be replaced at any time.
    log : ThrottledLog
        Log for messages that are refused.
    listener : TransformListener or None
        Where somebody else's odometry is received; None if tf2_msgs is not installed.
    sender : TransformSender
        Sender of our odometry on /tf.

    Raises
    ------
    ParameterError
        When the map cannot be read.
    """

    def __init__(self, node: Node, parameters: NodeParameters, log: ThrottledLog, listener: TransformListener | None,
                 sender: TransformSender) -> None:
        self._parameters = parameters
        self._node, self._log, self._listener, self._sender = node, log, listener, sender
        self._builds = parameters.map.mode == 'slam'
        known = None if self._builds or not parameters.map.file else _load(parameters)
        self._tracking = Tracking(parameters.for_odometry(), self._builds)
        node.context.on_shutdown(self._tracking.close)
        self._message = prepared_transform(parameters.map.frame, parameters.odom_frame)
        self._sent: deque[int] = deque(maxlen=SENT)
        self._other, self._other_heard = '', -WAIT
        self._pose = publisher(node, topics.POSE)
        self._state = publisher(node, topics.MAP_STATE)
        self._map = publisher(node, topics.MAP) if self._builds or known else None
        self._graph = publisher(node, topics.MAP_GRAPH) if self._builds else None
        self._subscribe_and_serve(known is None)
        self._received: OccupancyGrid | None = None
        self._reading: Future[Grid] | None = None
        self._drawing: Future[Picture | None] | None = None
        self._next_drawing = self._began_drawing = 0.0
        self._given_at: float | None = None
        self._found: Found | None = None
        self._transform = SE2() if self._builds else None
        self._pending: deque[BaseState] = deque(maxlen=WAITING)
        self._announce('' if self._builds or known else 'waiting for a map')
        self._began = time.monotonic()
        if self._builds and not parameters.map.file:
            node.get_logger().info('map.file is empty: ~/save_map needs it, and ros2 param set sets it')
        self._waits_for_map = not self._builds
        if known:
            self._use(known)

    @property
    def parameters(self) -> NodeParameters:
        """Parameters of the node; another ``map.file`` is read, in the thread, where the robot is localised."""
        return self._parameters

    @parameters.setter
    def parameters(self, value: NodeParameters) -> None:
        changed = value.map.file and value.map.file != self._parameters.map.file
        self._parameters = value
        if changed and not self._builds:
            self._reading = self._tracking.read(lambda: _load(value))

    def _subscribe_and_serve(self, without_map: bool) -> None:
        """Create the subscriptions and services of the mode."""
        if self._builds:
            self._node.create_service(Trigger, '~/save_map', self._on_save)
            return
        subscription(self._node, topics.INITIAL_POSE, self._on_initial_pose)
        self._node.create_service(Empty, 'reinitialize_global_localization', self._on_search)
        if without_map:
            subscription(self._node, topics.MAP, self._on_map)

    def close(self) -> None:
        """End the thread once a map that is being written is complete."""
        self._tracking.close()

    def restart(self) -> None:
        """Begin anew: the odometry was reset, so that its frame is another one."""
        self._tracking.restart()
        self._found = self._given_at = None
        self._transform = SE2() if self._builds else None
        self._pending.clear()
        self._sent.clear()
        self._announce(State.SEARCHING.value)

    def process(self, update: OdometryUpdate, state: BaseState, origin: SE2, sensor_pose: SE2) -> None:
        """Use a scan, and send what is known by now.

        Parameters
        ----------
        update : OdometryUpdate
        state : BaseState
            State of the base at the scan.
        origin, sensor_pose : SE2
            As for `base_state`.
        """
        in_odom = dataclasses.replace(update, pose=origin @ update.pose,
                                      covariance=turned(update.covariance, origin.theta))
        self._tracking.process(in_odom, sensor_pose)
        self._take_results()
        self._pending.append(state)
        self._send()

    def on_transform(self, transform: TransformStamped) -> None:
        """Note when another node sends a transform to ``odom_frame``."""
        stamp = in_nanoseconds(transform.header.stamp)
        if transform.child_frame_id == self.parameters.odom_frame and stamp not in self._sent:
            self._other, self._other_heard = transform.header.frame_id, time.monotonic()

    def on_timer(self) -> None:
        """Publish what was found since, and what has subscribers; called once a second."""
        self._take_results()
        if self._builds:
            self._draw()
        elif self._waits_for_map and time.monotonic() - self._began > PATIENCE:
            self._log.warn(f'no map is received on {self._node.resolve_topic_name("map")}: start a map server, or set '
                           'map.file')

    def diagnosis(self) -> DiagnosticStatus:
        """Return the state of the localisation for /diagnostics."""
        known = self._found and self._found.known
        text = self._announced
        if self._builds and known and known.state is not State.LOCALISED:
            text += ': nothing is added to the map until the robot is at a place of it'
        level = DiagnosticStatus.OK if known and known.state is State.LOCALISED else DiagnosticStatus.WARN
        values = []
        if known:
            best = known.hypotheses[0][1] if known.hypotheses else 0.0
            values = [KeyValue(key='probability of the most probable pose', value=f'{best:.3f}'),
                      KeyValue(key='probability of another place', value=f'{known.elsewhere:.3f}')]
            if self._found and self._found.base:
                text += f': {sigma_text(self._found.base.covariance, self.parameters.map.frame)}'
        if len(self._pending) == WAITING and self._transform:
            frames = f'from {self.parameters.odom_frame!r} to {self.parameters.base_frame!r}'
            text += f'; no transform {frames} is received at the time of the scans'
        if self._tracking.waiting >= SCANS_LEFT_OUT:
            level = DiagnosticStatus.ERROR
            text += f'; too slow: {self._tracking.waiting} scans wait, and others are left out'
        if self._tracking.fault:
            level = DiagnosticStatus.ERROR
            text += f'; the pose in the map is not updated: {self._tracking.fault}'
        if time.monotonic() - self._other_heard < WAIT:
            level = DiagnosticStatus.ERROR
            text += (f'; another node sends a transform to {self.parameters.odom_frame!r} too, from {self._other!r}: '
                     'stop one of the two')
        return DiagnosticStatus(level=level, name=f'{self._node.get_fully_qualified_name()}: pose in the map',
                                message=text, values=values)

    def _take_results(self) -> None:
        """Use a map that was read, and publish what was found."""
        if self._reading and self._reading.done():
            reading, self._reading = self._reading, None
            try:
                self._use(reading.result())
            except ParameterError as error:
                self._log.warn(f'{error}; the map before is kept')
        while self._tracking.results:
            found = self._found = self._tracking.results.popleft()
            self._transform = found.known.transform
            if found.base:
                self._pose.publish(pose_with_covariance(found.base, found.stamp, self.parameters.map.frame))
            if found.known.state.value != self._announced:
                self._announce_found(found)

    def _announce_found(self, found: Found) -> None:
        """Log a change of the state."""
        was_localised = self._announced == State.LOCALISED.value
        self._announce(found.known.state.value)
        if found.known.state is State.LOCALISED and found.base:
            self._node.get_logger().info(f'localised in the map: {found.base.pose.brief()}')
        elif was_localised:
            given = ''
            if self._given_at is not None:
                given = f', which was set on initialpose {time.monotonic() - self._given_at:.0f} s ago'
            self._log.warn(f'no longer localised: the scans do not suit the map at this pose{given}; searching the map')
            self._given_at = None
        else:
            self._node.get_logger().info(f'pose in the map: {found.known.state.value}')

    def _announce(self, state: str) -> None:
        """Publish the state."""
        self._announced = state or State.SEARCHING.value
        self._state.publish(String(data=self._announced))

    def _send(self) -> None:
        """Send the transform from the map to the odometry for the latest scan at which the odometry is known."""
        if not self._transform or not self._pending or self._sender.publisher is None or not self._message:
            return
        for number in reversed(range(len(self._pending))):
            state = self._pending[number]
            to_base = self._odometry_at(state)
            if to_base is None:
                continue
            stamp = state.stamp + round(self.parameters.map.transform_tolerance * SECOND)
            if not self._sent or stamp > self._sent[-1]:
                self._sent.append(stamp)
                self._message.publish(self._sender.publisher, stamp,
                                      transform_numbers(self._transform @ state.pose @ to_base.inverse()))
            for _ in range(number + 1):
                self._pending.popleft()
            return

    def _odometry_at(self, state: BaseState) -> SE2 | None:
        """Return the pose of the base in ``odom_frame`` as /tf has it at a scan; None if it is not known yet."""
        if self._sender.active and not self._sender.conflict:
            return state.pose
        if self._listener is None:
            return None
        return self._listener.planar(self.parameters.odom_frame, self.parameters.base_frame, state.stamp)

    def _use(self, grid: Grid) -> None:
        """Localise in this map, and publish it if it is our own."""
        self._waits_for_map = False
        self._tracking.use_map(grid)
        self._node.get_logger().info(f'map of {grid.values.shape[1] - 2} x {grid.values.shape[0] - 2} cells of '
                                     f'{grid.resolution:g} m: searching')
        if self._map:
            self._map.publish(grid_to_message(grid, self._now(), self.parameters.map.frame))

    def _on_map(self, message: OccupancyGrid) -> None:
        same = self._received and (message.info.origin, message.info.resolution, message.data) == (
            self._received.info.origin, self._received.info.resolution, self._received.data)
        self._received = message
        if same:
            return
        try:
            self._use(grid_from_message(message))
        except (PoseError, ValueError) as error:
            self._log.warn(f'{self._node.resolve_topic_name("map")} is ignored: {error}')

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        try:
            given = initial_pose(message, self.parameters.map.frame)
        except PoseError as error:
            self._log.warn(f'initialpose is ignored: {error}')
            return
        self._given_at = time.monotonic()
        self._tracking.set_pose(given)
        self._node.get_logger().info(f'pose in the map set on initialpose: {given.pose.brief()}')

    def _on_search(self, _request: Empty.Request, response: Empty.Response) -> Empty.Response:
        self._given_at = None
        self._tracking.search()
        self._node.get_logger().info('reinitialize_global_localization was called: searching the map')
        return response

    async def _on_save(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Write the map; other callbacks are executed meanwhile."""
        name = self.parameters.map.file
        if not name:
            response.success, response.message = False, f'map.file = {name!r}: expected the file to write'
            return response
        try:
            path = expanded('map.file', name, ParameterError).absolute()
        except ParameterError as error:
            response.success, response.message = False, str(error)
            return response
        self._node.get_logger().info(f'writing the map to {path}')
        answer = Answer(executor=self._node.executor)
        # The task wakes the executor.
        answer.add_done_callback(lambda _: None)
        self._tracking.save(path).add_done_callback(lambda done: answer.set_result(done.result()))
        fault = await answer
        response.success, response.message = not fault, fault or str(path)
        if fault:
            self._log.warn(f'the map is not written: {fault}')
        return response

    def _draw(self) -> None:
        """Publish the map that is built and its graph, if they have subscribers."""
        assert self._map and self._graph
        now = time.monotonic()
        if self._drawing and self._drawing.done():
            picture, self._drawing = self._drawing.result(), None
            self._next_drawing = now + max(DRAWN_EVERY, (now - self._began_drawing) / DRAWN_SHARE)
            if picture:
                frame = self.parameters.map.frame
                self._map.publish(grid_to_message(picture.grid, self._now(), frame))
                self._graph.publish(graph_to_message(picture.graph, self._now(), frame))
        watched = self._map.get_subscription_count() + self._graph.get_subscription_count()
        if self._drawing is None and watched and now >= self._next_drawing and self._found:
            self._drawing, self._began_drawing = self._tracking.draw(), now

    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)


def _load(parameters: NodeParameters) -> Grid:
    """Read the map of ``map.file``."""
    name = parameters.map.file
    try:
        return load_grid(expanded('map.file', name, ParameterError), parameters.for_odometry())
    except MapError as error:
        raise ParameterError(f'map.file = {name!r}: {error}') from None
