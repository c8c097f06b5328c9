# SPDX-License-Identifier: Apache-2.0
"""Services of the node, and the topic ``set_pose``."""
import time
from collections import deque
from collections.abc import Callable

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from ...core.errors import ParameterError
from ...core.odometry.records import OdometryUpdate
from ...core.registration.records import Prior
from ...paths import expanded
from ...recordings.snapshots import Snapshot, SnapshotUpdate, write_snapshot
from ...robot.base_state import InitialPose
from ...robot.parameters import NodeParameters
from ..throttled_log import ThrottledLog
from .endpoints import subscription
from .messages import PoseError, initial_pose
from .topics import SET_POSE


class Services:
    """Services ``~/reset``, ``~/pause`` and ``~/snapshot``, and subscription to the topic ``set_pose``.

    The `parameters` may be replaced at any time. `log` gets the poses that are refused. ``reset(reason, initial)``
    resets the odometry to an `InitialPose`, or for None to ``initial_pose``. While `paused`, scans are ignored.
    """

    def __init__(self, node: Node, parameters: NodeParameters, log: ThrottledLog,
                 reset: Callable[[str, InitialPose | None], None]) -> None:
        self.parameters = parameters
        self.paused = False
        self._node = node
        self._log = log
        self._reset = reset
        self._updates: deque[SnapshotUpdate] = deque(maxlen=parameters.snapshot.scans)
        node.create_service(Trigger, '~/reset', self._on_reset)
        node.create_service(SetBool, '~/pause', self._on_pause)
        node.create_service(Trigger, '~/snapshot', self._on_snapshot)
        subscription(node, SET_POSE, self._on_pose)

    def keep(self, update: OdometryUpdate, prior: Prior | None) -> None:
        """Store the `OdometryUpdate` of a scan and its external prior for a later snapshot."""
        if self._updates.maxlen != self.parameters.snapshot.scans:
            self._updates = deque(self._updates, self.parameters.snapshot.scans)
        self._updates.append(SnapshotUpdate.of(update, prior))

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._reset('reset was called', None)
        response.success, response.message = True, 'the base is at initial_pose at the next scan'
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        changed, self.paused = self.paused != request.data, request.data
        response.success = True
        response.message = 'paused: scans are ignored' if self.paused else 'running'
        if changed:
            self._node.get_logger().info(response.message)
        return response

    def _on_snapshot(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._updates:
            response.success, response.message = False, 'no scan was processed yet'
            return response
        parameters = {name: list(value) if isinstance(value, tuple) else value
                      for name, value in self.parameters.flatten().items()}
        try:
            folder = expanded('advanced.snapshot.folder', self.parameters.snapshot.folder, ParameterError)
        except ParameterError as error:
            response.success, response.message = False, str(error)
            return response
        when = time.strftime('%Y%m%d_%H%M%S')
        path = (folder / f'{self._node.get_name()}_{when}_{self._updates[-1].stamp}.npz').absolute()
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_snapshot(path, Snapshot(parameters, list(self._updates)))
        except OSError as error:
            response.success, response.message = False, f'{path}: cannot be written: {error.strerror}'
            return response
        response.success, response.message = True, str(path)
        self._node.get_logger().info(f'snapshot of {len(self._updates)} scans: {path}')
        return response

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        try:
            initial = initial_pose(message, self.parameters.odom_frame)
        except PoseError as error:
            self._log.warn(f'set_pose is ignored: {error}')
            return
        pose = initial.pose
        self._reset(f'set_pose to x {pose.x:.3f} m, y {pose.y:.3f} m, yaw {pose.theta:.3f} rad', initial)
