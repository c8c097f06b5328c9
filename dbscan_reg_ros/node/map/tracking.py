# SPDX-License-Identifier: Apache-2.0
"""The localiser or the mapper in a thread of its own, so that no callback waits for it."""
import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...core.errors import DbscanRegError
from ...core.geometry.se2 import DOF, SE2, lever_arm
from ...core.odometry.records import OdometryUpdate
from ...core.parameters.tree import Parameters
from ...places.grid import Grid
from ...places.localizer import Localization, Localizer, State
from ...places.mapper import Mapper
from ...places.pose_graph import PoseGraph
from ...robot.base_state import InitialPose

NICENESS = 10
"""By how much the thread is nicer than that of the odometry, which goes first where both want one processor; on Linux
the niceness is that of a thread."""
WAITING = 100
"""While so many scans wait, those that are no key frames are left out."""


class Found(NamedTuple):
    """What is known after a scan.

    Attributes
    ----------
    stamp : int [ns]
        Of the scan.
    known : Localization
        Its `transform` is that from ``odom_frame`` to the frame of the map.
    base : InitialPose or None
        Pose of the base in the map; None before the first answer.
    """

    stamp: int
    known: Localization
    base: InitialPose | None


class Picture(NamedTuple):
    """A map that is built: its graph, and the grid of what was seen."""

    graph: PoseGraph
    grid: Grid


class Tracking:
    """Tracks the robot in a map, in a thread of its own; all methods return at once.

    The methods take effect in the order of their calls. A map that is being written when the process ends is completed.

    Parameters
    ----------
    parameters : Parameters
        Those of the odometry.
    builds : bool
        Build a map; otherwise `use_map` gives one.

    Attributes
    ----------
    results : deque of Found
        What was found since it was last emptied.
    fault : str
        Error of the latest step; empty if there was none.
    waiting : int
        Number of scans that wait; once they are `WAITING`, scans are left out.
    """

    def __init__(self, parameters: Parameters, builds: bool) -> None:
        self.results: deque[Found] = deque()
        self._parameters = parameters
        self._thread = ThreadPoolExecutor(1, 'map', os.nice, (NICENESS,))
        # Both are used in the thread only.
        self._mapper = Mapper(parameters) if builds else None
        self._localizer: Localizer | None = None
        self._last: tuple[OdometryUpdate, SE2, Localization | None] | None = None
        self._given: InitialPose | None = None
        self._drawn = np.empty((0, DOF))
        self.fault, self.waiting, self._restarts = '', 0, 0

    def close(self) -> None:
        """Leave out what waits, but for maps that are to be written."""
        self._restarts += 1
        self._thread.shutdown(wait=False)

    def restart(self) -> None:
        """Forget the pose, and the map that is built: the odometry was reset."""
        self._restarts += 1
        self.results.clear()
        self._do(self._restart)

    def use_map(self, grid: Grid) -> None:
        """Localise in this map; if it replaces another one, the pose is kept until the scans contradict it."""
        self._thread.submit(self._use_map, grid).add_done_callback(self._note)

    def read(self, load: Callable[[], Grid]) -> 'Future[Grid]':
        """Read a map, which `use_map` does not use yet."""
        return self._thread.submit(load)

    def process(self, update: OdometryUpdate, sensor_pose: SE2) -> None:
        """Use the next scan.

        Parameters
        ----------
        update : OdometryUpdate
            With the pose in ``odom_frame``.
        sensor_pose : SE2
            Pose in the base frame of the sensor that is tracked.
        """
        if self.waiting < WAITING or update.is_key_frame:
            self.waiting += 1
            self._do(lambda: self._process(update, sensor_pose)).add_done_callback(self._count_down)

    def set_pose(self, given: InitialPose) -> None:
        """Set the pose of the base in the map at the latest scan."""
        self._do(lambda: self._set_pose(given))

    def search(self) -> None:
        """Search the whole map."""
        self._do(self._search)

    def save(self, path: Path) -> 'Future[str]':
        """Write the map that is built to a file; the result says why it cannot be written, or is empty."""
        return self._thread.submit(self._save, path)

    def draw(self) -> 'Future[Picture | None]':
        """Draw the map that is built; the result is None if it has not changed since it was drawn."""
        return self._thread.submit(self._draw)

    def _do(self, step: Callable[[], None]) -> 'Future[None]':
        """Let the thread do a step, unless a restart comes first."""
        restarts = self._restarts

        def unless_restarted() -> None:
            if restarts == self._restarts:
                step()

        future = self._thread.submit(unless_restarted)
        future.add_done_callback(self._note)
        return future

    def _note(self, done: 'Future[None]') -> None:
        """Keep the error of a step; it is also printed, with its traceback, as it is raised in the thread."""
        error = done.exception()
        self.fault = f'{type(error).__name__}: {error}' if error else ''
        done.result()

    def _count_down(self, _done: 'Future[None]') -> None:
        self.waiting -= 1

    def _restart(self) -> None:
        self._last = self._given = None
        for tracker in (self._mapper, self._localizer):
            if tracker:
                tracker.reset()

    def _use_map(self, grid: Grid) -> None:
        self._localizer = Localizer(grid, self._parameters)
        update, _, known = self._last or (None, None, None)
        if update and known and known.state is State.LOCALISED and known.pose and known.covariance is not None:
            self._localizer.set_pose(known.pose, known.covariance, update)

    def _process(self, update: OdometryUpdate, sensor_pose: SE2) -> None:
        tracker = self._mapper or self._localizer
        known = tracker.process(update) if tracker else None
        self._last = update, sensor_pose, known
        if self._given:
            self._set_pose(self._given)
        if known:
            base = None
            if known.pose and known.covariance is not None:
                base = _at(known.pose, known.covariance, known.pose @ sensor_pose.inverse())
            self.results.append(Found(update.stamp, known, base))

    def _search(self) -> None:
        if self._localizer:
            self._localizer.search()

    def _set_pose(self, given: InitialPose) -> None:
        self._given = given
        if self._last and self._localizer:
            (update, sensor_pose, _), self._given = self._last, None
            moved = _at(given.pose, given.covariance, given.pose @ sensor_pose)
            self._localizer.set_pose(moved.pose, moved.covariance, update)

    def _save(self, path: Path) -> str:
        if self._mapper is None or self._last is None:
            return 'no scan was processed yet'
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._mapper.map(self._last[1]).save(path)
        except OSError as error:
            return f'{path}: cannot be written: {error.strerror}'
        return ''

    def _draw(self) -> Picture | None:
        made = self._mapper and self._mapper.map()
        if not made or np.array_equal(made.graph.poses, self._drawn):
            return None
        self._drawn = made.graph.poses
        try:
            return Picture(made.graph, Grid.of_map(made, self._parameters))
        except DbscanRegError:
            return None


def _at(pose: SE2, covariance: NDArray[np.float64], other: SE2) -> InitialPose:
    """Return the pose of `other`, on one rigid body with `pose`, and its covariance from that of `pose`."""
    lever = lever_arm(other.x - pose.x, other.y - pose.y)
    return InitialPose(other, lever @ covariance @ lever.T)
