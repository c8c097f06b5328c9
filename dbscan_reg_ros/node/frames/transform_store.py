# SPDX-License-Identifier: Apache-2.0
"""Transforms by their frames and times: with tf2_ros where it is installed, else with a small store of our own."""
import bisect

import numpy as np

from ..interfaces.messages import matrix_from_pose, pose_from_message, stamp_from_message

MAX_CHAIN = 100
SPAN = 10_000_000_000
"""So much of the past is kept [ns], here as in tf2_ros."""
SILENT = 5_000_000_000
"""A moving transform that has not come for so long [ns] does not go on."""


class NoTransformError(LookupError):
    """Two frames are not connected."""


def make_store():
    """A `Tf2Store` where tf2_ros is installed, else a `TransformStore`."""
    try:
        return Tf2Store()
    except ModuleNotFoundError:
        return TransformStore()


class TransformStore:
    """Transforms composed along their tree and interpolated between their stamps.

    Where one comes more than `SPAN` before the newest between the same frames, time has gone back. Where a frame has a static
    transform, a moving one counts only while it goes on: a single one is a stray.
    """

    def __init__(self):
        self._static = {}
        self._moving = {}

    def add(self, message, static):
        """Keep a TransformStamped message; one whose numbers make no rotation is passed over."""
        pose = pose_from_message(message.transform)
        if pose is None:
            return
        parent, child, stamp = message.header.frame_id, message.child_frame_id, stamp_from_message(message.header.stamp)
        edges = self._static if static else self._moving
        edge = edges.get(child)
        if edge is None or edge.parent != parent:
            edge = edges[child] = _Edge(parent, static)
        elif edge.starts_again(stamp):
            self.clear()
            edge = edges[child] = _Edge(parent, static)
        edge.add(stamp, pose)

    def clear(self):
        """Forget what moves: time has gone back."""
        self._moving.clear()

    def lookup(self, target, source, stamp):
        """How to get from one frame to another.

        Parameters
        ----------
        target, source : str
        stamp : int
            [ns]

        Returns
        -------
        (4, 4) float
            Takes points in `source` to `target`, at the known time nearest to `stamp`.
        bool
            Whether that is `stamp` itself.

        Raises
        ------
        NoTransformError
            When the frames are not connected.
        """
        up, down = self._ancestors(source, stamp), self._ancestors(target, stamp)
        common = next((frame for frame in up if frame in down), None)
        if common is None:
            raise NoTransformError(f'{source!r} and {target!r} are not connected')
        from_source, known_source = self._matrix(up[:up.index(common)], stamp)
        from_target, known_target = self._matrix(down[:down.index(common)], stamp)
        return np.linalg.inv(from_target) @ from_source, known_source and known_target

    def _edge(self, frame, stamp):
        """What counts for `frame` at `stamp`: an _Edge to its parent, or None."""
        static, moving = self._static.get(frame), self._moving.get(frame)
        return moving if static is None or moving and moving.has_velocity(stamp) else static

    def _ancestors(self, frame, stamp):
        """`frame`, its parent, the parent of that, ..."""
        frames = [frame]
        while (edge := self._edge(frame, stamp)) and len(frames) < MAX_CHAIN:
            frame = edge.parent
            frames.append(frame)
        return frames

    def _matrix(self, frames, stamp):
        """The product of the transforms from each of `frames` to its parent, and whether all are known at `stamp`."""
        matrix, known = np.eye(4), True
        for frame in frames:
            step, exact = self._edge(frame, stamp).at(stamp)
            matrix, known = step @ matrix, known and exact
        return matrix, known


class _Edge:
    """The transform from one frame to its parent as it changes in time."""

    def __init__(self, parent, static):
        self.parent = parent
        self.static = static
        self._stamps = []
        self._poses = []

    def starts_again(self, stamp):
        """Whether a transform at `stamp` belongs to another run than those before it."""
        return not self.static and stamp < self._stamps[-1] - SPAN

    def has_velocity(self, stamp):
        """Whether several transforms have come, and `stamp` is not far from them."""
        return len(self._stamps) > 1 and self._stamps[0] - SILENT <= stamp <= self._stamps[-1] + SILENT

    def add(self, stamp, pose):
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

    def at(self, stamp):
        """(matrix at the known time nearest to `stamp`, whether that is `stamp` itself)"""
        if self.static:
            return matrix_from_pose(*self._poses[-1]), True
        after = bisect.bisect_left(self._stamps, stamp)
        if after == len(self._stamps):
            return matrix_from_pose(*self._poses[-1]), False
        if self._stamps[after] == stamp or after == 0:
            return matrix_from_pose(*self._poses[after]), self._stamps[after] == stamp
        (here, turned), (there, turned_there) = self._poses[after - 1], self._poses[after]
        share = (stamp - self._stamps[after - 1]) / (self._stamps[after] - self._stamps[after - 1])
        if turned @ turned_there < 0.0:
            turned_there = -turned_there
        return matrix_from_pose(here + share * (there - here), turned + share * (turned_there - turned)), True


class Tf2Store:
    """The same on top of a tf2_ros buffer.

    Raises
    ------
    ModuleNotFoundError
        When tf2_ros is not installed.
    """

    def __init__(self):
        import tf2_ros
        self._tf2 = tf2_ros
        self._buffer = tf2_ros.Buffer()
        self._newest = {}
        self._static = set()

    def add(self, message, static):
        """As in `TransformStore`; the buffer by itself takes none that is so much older than the newest."""
        child, stamp = message.child_frame_id, stamp_from_message(message.header.stamp)
        if static:
            self._static.add(child)
            self._buffer.set_transform_static(message, 'scan_matcher')
            return
        newest = self._newest.get(child)
        if newest is not None and stamp < newest - SPAN:
            self.clear()
            newest = None
        self._newest[child] = stamp if newest is None else max(stamp, newest)
        # In the buffer one transform, though a stray, takes the place of a static one for good.
        if child not in self._static or newest is not None and abs(stamp - newest) <= SILENT:
            self._buffer.set_transform(message, 'scan_matcher')

    def clear(self):
        """As in `TransformStore`."""
        self._buffer.clear()
        self._newest.clear()

    def lookup(self, target, source, stamp):
        """As in `TransformStore`, but outside the known time it is the latest, and there is no time before 1970."""
        from rclpy.time import Time
        try:
            if stamp >= 0:
                return self._at(target, source, Time(nanoseconds=stamp)), True
        except self._tf2.ExtrapolationException:
            pass
        except self._tf2.TransformException as error:
            raise NoTransformError(str(error)) from None
        try:
            return self._at(target, source, Time()), False
        except self._tf2.TransformException as error:
            raise NoTransformError(str(error)) from None

    def _at(self, target, source, time):
        pose = pose_from_message(self._buffer.lookup_transform(target, source, time).transform)
        if pose is None:
            raise NoTransformError(f'the transform from {source!r} to {target!r} is none')
        return matrix_from_pose(*pose)
