# SPDX-License-Identifier: Apache-2.0
"""Buffer of transforms."""
import bisect
import math

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import NDArray

from ...core.scan import in_nanoseconds
from ...recordings.poses import PoseError, matrix_of, pose_of_transform


class NoTransformError(LookupError):
    """Two frames are not connected by transforms."""


MAX_CHAIN = 100
SPAN = 10_000_000_000
"""Duration [ns] for which transforms are kept, the same as in tf2_ros."""
SILENT = 5_000_000_000
"""Time [ns] without a transform on /tf after which its sender counts as stopped."""

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Translation ``(3,)`` [m] and unit quaternion ``(4,)`` (x, y, z, w)."""


class TransformStore:
    """Buffer of transforms: composes them along the tree of frames and interpolates between stamps.

    If a transform is more than `SPAN` older than the newest one between the same frames, time has gone back, and the
    buffer is cleared. If a frame has a static transform, transforms to this frame on /tf are used only if several
    arrive within `SILENT`: a single transform is regarded as an outlier.
    """

    def __init__(self) -> None:
        self._static: dict[str, _Edge] = {}
        self._moving: dict[str, _Edge] = {}

    def add(self, message: TransformStamped, static: bool) -> None:
        """Add a transform, unless its values are invalid."""
        try:
            pose = pose_of_transform(message.transform)
        except PoseError:
            return
        parent, child, stamp = message.header.frame_id, message.child_frame_id, in_nanoseconds(message.header.stamp)
        edges = self._static if static else self._moving
        edge = edges.get(child)
        if edge is None or edge.parent != parent:
            edge = edges[child] = _Edge(parent, static)
        elif edge.has_restarted(stamp):
            self.clear()
            edge = edges[child] = _Edge(parent, static)
        edge.add(stamp, pose)

    @property
    def parents(self) -> dict[str, str]:
        """Frame -> its parent, of all transforms received."""
        return {child: edge.parent for edges in (self._moving, self._static) for child, edge in edges.items()}

    def clear(self) -> None:
        """Remove the transforms that were received on /tf, because time has gone back."""
        self._moving.clear()

    def lookup(self, target: str, source: str, stamp: int) -> tuple[NDArray[np.float64], bool]:
        """Return the matrix ``(4, 4)`` from the frame `source` to `target` [m], and whether it is known at `stamp`.

        It is that of the known time nearest to the `stamp` [ns]. Raises a NoTransformError when the frames are not
        connected.
        """
        up, down = self._ancestors(source, stamp), self._ancestors(target, stamp)
        common = next((frame for frame in up if frame in down), None)
        if common is None:
            raise NoTransformError(f'{source!r} and {target!r} are not connected')
        from_source, known_source = self._matrix(up[:up.index(common)], stamp)
        from_target, known_target = self._matrix(down[:down.index(common)], stamp)
        return np.linalg.inv(from_target) @ from_source, known_source and known_target

    def _edge(self, frame: str, stamp: int) -> '_Edge | None':
        """Return the edge from `frame` to its parent that is valid at `stamp` [ns]; None if there is no such edge."""
        static, moving = self._static.get(frame), self._moving.get(frame)
        return moving if static is None or (moving and moving.is_active(stamp)) else static

    def _ancestors(self, frame: str, stamp: int) -> list[str]:
        """List `frame` and its ancestors up to the root: its parent, its grandparent and so on."""
        frames = [frame]
        while (edge := self._edge(frame, stamp)) and len(frames) < MAX_CHAIN:
            frame = edge.parent
            frames.append(frame)
        return frames

    def _matrix(self, frames: list[str], stamp: int) -> tuple[NDArray[np.float64], bool]:
        """Compose the transforms from each of `frames` to its parent; return also whether all are known at `stamp`."""
        matrix, known = np.eye(4), True
        for frame in frames:
            edge = self._edge(frame, stamp)
            assert edge
            step, exact = edge.at(stamp)
            matrix, known = step @ matrix, known and exact
        return matrix, known


class _Edge:
    """Transform from one frame to its parent over time."""

    def __init__(self, parent: str, static: bool) -> None:
        self.parent = parent
        self.static = static
        self._stamps: list[int] = []
        self._poses: list[Pose] = []

    def has_restarted(self, stamp: int) -> bool:
        """Whether a transform at `stamp` [ns] is more than `SPAN` older than the newest one: time has gone back."""
        return not self.static and stamp < self._stamps[-1] - SPAN

    def is_active(self, stamp: int) -> bool:
        """Whether several transforms were received whose stamps are less than `SILENT` away from `stamp` [ns]."""
        return len(self._stamps) > 1 and self._stamps[0] - SILENT <= stamp <= self._stamps[-1] + SILENT

    def add(self, stamp: int, pose: Pose) -> None:
        """Add the transform at `stamp` [ns]; a static transform replaces the previous static one."""
        if self.static:
            self._stamps, self._poses = [], []
        index = bisect.bisect_left(self._stamps, stamp)
        if index < len(self._stamps) and self._stamps[index] == stamp:
            self._poses[index] = pose
            return
        self._stamps.insert(index, stamp)
        self._poses.insert(index, pose)
        if self._stamps[-1] - self._stamps[0] > 2 * SPAN:
            old = bisect.bisect_left(self._stamps, self._stamps[-1] - SPAN)
            del self._stamps[:old], self._poses[:old]

    def at(self, stamp: int) -> tuple[NDArray[np.float64], bool]:
        """Return the matrix at the known time nearest to `stamp` [ns], and whether it is known at `stamp` itself."""
        if self.static:
            return matrix_of(*self._poses[-1]), True
        after = bisect.bisect_left(self._stamps, stamp)
        if after == len(self._stamps):
            return matrix_of(*self._poses[-1]), False
        if self._stamps[after] == stamp or after == 0:
            return matrix_of(*self._poses[after]), self._stamps[after] == stamp
        (t0, q0), (t1, q1) = self._poses[after - 1], self._poses[after]
        ratio = (stamp - self._stamps[after - 1]) / (self._stamps[after] - self._stamps[after - 1])
        return matrix_of(t0 + ratio * (t1 - t0), _slerp(q0, q1, ratio)), True


def _slerp(q0: NDArray[np.float64], q1: NDArray[np.float64], ratio: float) -> NDArray[np.float64]:
    """Interpolate between unit quaternions ``(4,)`` with a constant rate of rotation, the shorter way round."""
    if q0 @ q1 < 0.0:
        q1 = -q1
    half = 2.0 * math.atan2(float(np.linalg.norm(q1 - q0)), float(np.linalg.norm(q1 + q0)))
    return q0 if half == 0.0 else np.sin((1.0 - ratio) * half) * q0 + np.sin(ratio * half) * q1
