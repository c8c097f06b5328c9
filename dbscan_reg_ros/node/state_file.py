# SPDX-License-Identifier: Apache-2.0
"""The pose of the base in a file, so that it is kept over a restart of the node."""
import json
import time

import numpy as np
from rclpy.node import Node

from ..core.errors import ParameterError
from ..core.geometry.se2 import DOF, SE2
from ..core.geometry.symmetric_matrix import as_covariance
from ..core.odometry.models.stamps import ScanInterval
from ..core.odometry.models.unobserved_motion import motion_without_scans
from ..paths import expanded
from ..recordings.files import replacing
from ..robot.base_state import BaseState, InitialPose
from ..robot.parameters import NodeParameters

PERIOD = 5.0
"""Least interval [s] between two writings."""
OLDEST = 3600.0
"""Longest time [s] without the node for which the pose is used: then it may be anywhere within some 100 m."""


class StateFile:
    """Writes the pose of the base to ``state_file`` at most every `PERIOD`, and reads it at the start.

    Without ``state_file`` nothing is written or read.
    """

    def __init__(self, node: Node, parameters: NodeParameters) -> None:
        self._logger = node.get_logger()
        self._path = expanded('state_file', parameters.state_file, ParameterError) if parameters.state_file else None
        self._frames = {'odom_frame': parameters.odom_frame, 'base_frame': parameters.base_frame}
        self._parameters = parameters.for_odometry()
        self._next, self._written, self._failed = 0.0, -1, False

    def load(self) -> InitialPose | None:
        """Return the pose of the file, with the covariance of the motion since; None if there is none to use."""
        if self._path is None or not self._path.exists():
            return None
        try:
            found = json.loads(self._path.read_text(encoding='utf-8'))
            pose, covariance = SE2.from_array(found['pose']), as_covariance(found['covariance'])
            frames, missed = {name: found[name] for name in self._frames}, time.time() - float(found['time'])
        except OSError as error:
            self._logger.warning(f'state_file {self._path}: cannot be read: {error.strerror}')
            return None
        except (ValueError, KeyError, TypeError):
            self._logger.warning(f'state_file {self._path}: damaged, or of another program; not used, and overwritten '
                                 'with the first pose')
            return None
        if frames != self._frames:
            self._logger.warning(f'state_file {self._path}: the pose is of {frames}, expected {self._frames}; not used')
            return None
        if not 0.0 <= missed <= OLDEST:
            self._logger.warning(f'state_file {self._path}: the pose is {missed:.0f} s old, expected at most '
                                 f'{OLDEST:.0f} s; not used')
            return None
        unknown = motion_without_scans(np.zeros(DOF), ScanInterval(missed, missed, 0.0), self._parameters)
        self._logger.info(f'pose of {missed:.0f} s ago from state_file: {pose.brief()}')
        return InitialPose(pose, covariance + unknown.covariance)

    def keep(self, state: BaseState) -> None:
        """Write the state of the base, unless it was written within the last `PERIOD`, or is the same."""
        if time.monotonic() >= self._next:
            self.write(state)

    def write(self, state: BaseState) -> None:
        """Write the state of the base, if it has changed; the file is complete at any time."""
        if self._path is None or state.stamp == self._written:
            return
        self._next, self._written = time.monotonic() + PERIOD, state.stamp
        try:
            with replacing(self._path) as file:
                json.dump({**self._frames, 'time': time.time(), 'pose': state.pose.as_tuple(),
                           'covariance': state.covariance.tolist()}, file)
            self._failed = False
        except OSError as error:
            if not self._failed:
                self._logger.warning(f'state_file {self._path}: cannot be written: {error.strerror}')
            self._failed = True
