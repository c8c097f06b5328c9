# SPDX-License-Identifier: Apache-2.0
"""Key-frame window: the latest key frames, their lookup tables and the local map."""
import cmath
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...features.oriented_points import OrientedPoints, high_leverage
from ...features.records import Features
from ...geometry.robust_kernel import kernel
from ...geometry.se2 import SE2, unit_complex
from ...parameters.registration import DensityParameters
from ...registration.point_to_line import linear_residuals, origins
from .correspondences import Correspondences
from .key_frame import KeyFrame
from .local_map import older_map_points
from .stacked_lookup import FreeSpaceStack, LikelihoodFieldStack


class KeyFrameWindow:
    """The latest key frames in order of time; immutable.

    Parameters
    ----------
    frames : sequence of KeyFrame
        At least one.

    Attributes
    ----------
    poses : FramePoses
    fields : LikelihoodFieldStack
    backend : Backend
        Backend of the latest key frame.
    """

    def __init__(self, frames: Sequence[KeyFrame]):
        self.frames = tuple(frames)
        poses = np.array([(frame.pose.x, frame.pose.y, frame.pose.theta) for frame in self.frames])
        self.poses = FramePoses(origins(poses), unit_complex(-poses[:, 2:]))
        self.backend = self.latest.features.backend
        fields = [frame.features.likelihood_field for frame in self.frames]
        self.fields = LikelihoodFieldStack(fields, *self.poses)
        self._free_space: dict[int, FreeSpaceStack] = {}
        self._local_maps: dict[KeyFrame, Features] = {}
        self._parts: dict[tuple[KeyFrame, ...], KeyFrameWindow] = {}
        self.sensors = frozenset(frame.sensor.name for frame in self.frames)

    @property
    def latest(self) -> KeyFrame:
        """The latest key frame of any sensor."""
        return self.frames[-1]

    def frames_of(self, sensor: str) -> tuple[KeyFrame, ...]:
        """Return the key frames of a `sensor`, the latest last; if it has none, the key frames of all sensors."""
        return tuple(frame for frame in self.frames if frame.sensor.name == sensor) or self.frames

    def local_map_of(self, sensor: str) -> Features:
        """Return the features of the latest key frame of a `sensor`, completed by points of other key frames.

        Points are taken from all key frames whose pose was constrained, also from key frames of other sensors.
        """
        latest = self.frames_of(sensor)[-1]
        if latest not in self._local_maps:
            others = [frame for frame in self.frames if frame is not latest and frame.constrained]
            points = others and self.backend.step(older_map_points)(others, latest, latest.features.density)
            self._local_maps[latest] = replace(latest.features, map_points=points) if points else latest.features
        return self._local_maps[latest]

    def of_rank(self, rank: int) -> 'KeyFrameWindow | None':
        """Return the window of the key frames of all sensors of this `Sensor.rank`; None if there is none."""
        frames = tuple(frame for frame in self.frames if frame.sensor.rank == rank)
        return self._part(frames) if frames else None

    def of_sensor(self, sensor: str) -> 'KeyFrameWindow':
        """Return the window of `frames_of` a `sensor`."""
        if len(self.sensors) == 1 or sensor not in self.sensors:
            return self
        return self._part(self.frames_of(sensor))

    def is_in(self, part: 'KeyFrameWindow') -> NDArray[np.bool_]:
        """Return ``(K,)``: whether each of the `frames` is a key frame of another window, too."""
        frames = frozenset(part.frames)
        return np.array([frame in frames for frame in self.frames])

    def _part(self, frames: tuple[KeyFrame, ...]) -> 'KeyFrameWindow':
        """Return the window of some of the `frames`, which is made once."""
        if frames not in self._parts:
            self._parts[frames] = KeyFrameWindow(frames)
        return self._parts[frames]

    def without(self, sensor: str) -> 'KeyFrameWindow':
        """Return a window without the key frames of a `sensor`, unless it has no others."""
        if sensor not in self.sensors or len(self.sensors) == 1:
            return self
        return KeyFrameWindow([frame for frame in self.frames if frame.sensor.name != sensor])

    def with_features(self, found: Mapping[int, tuple[Features, SE2]], sensor: str) -> 'KeyFrameWindow':
        """Return a window whose key frames of a `sensor` have the features and poses `found`, by number; else none."""
        frames = [frame if frame.sensor.name != sensor else replace(
            frame, features=found[frame.number][0], pose=found[frame.number][1])
            for frame in self.frames if frame.sensor.name != sensor or frame.number in found]
        return KeyFrameWindow(frames)

    def with_frame(self, frame: KeyFrame, size: int, latest: bool = True) -> 'KeyFrameWindow':
        """Return a window with one more key frame: the `latest` of its sensor, or inserted before the latest.

        The local maps of the other sensors are kept until these have a new key frame: with several sensors nearly every
        scan would otherwise need a new one.

        Parameters
        ----------
        frame : KeyFrame
        size : int
            Largest number of key frames for each sensor.
        latest : bool
        """
        at = len(self.frames) if latest else self.frames.index(self.frames_of(frame.sensor.name)[-1])
        frames = (*self.frames[:at], frame, *self.frames[at:])
        window = KeyFrameWindow(latest_frames(frames, size))
        window._local_maps = {latest: features for latest, features in self._local_maps.items()
                              if latest.sensor.name != frame.sensor.name}
        return window

    def free_space(self, frames: int) -> FreeSpaceStack:
        """Return the free-space profiles of the latest `frames` key frames."""
        if frames not in self._free_space:
            profiles = [frame.features.free_space for frame in self.frames[-frames:]]
            self._free_space = {frames: FreeSpaceStack(profiles, *(part[-frames:] for part in self.poses))}
        return self._free_space[frames]

    def correspondences(self, pose: SE2, points: OrientedPoints, density: DensityParameters) -> Correspondences:
        """Call `look_up_correspondences` for this window with the implementation of the backend."""
        return self.backend.step(look_up_correspondences)(self, pose, points, density)


def latest_frames(frames: Sequence[KeyFrame], size: int) -> Sequence[KeyFrame]:
    """Return the latest `size` x (number of sensors) key frames."""
    return frames[-size * len({frame.sensor.name for frame in frames}):]


class FramePoses(NamedTuple):
    """Poses of K key frames in the odometry frame.

    Attributes
    ----------
    origins : (K, 1) complex [m]
    rotations : (K, 1) complex
        Unit numbers that rotate from the odometry frame into the frame of each key frame.
    """

    origins: NDArray[np.complex128]
    rotations: NDArray[np.complex128]


class Pairs(NamedTuple):
    """Pairs of a point and a line of a key frame, M of them.

    Attributes
    ----------
    frame : (M,) int
        Index of the key frame.
    point : (M,) int
        Index of the point.
    rotated_points : (M,) complex [m]
        Points relative to the sensor, rotated into the odometry frame.
    normals : (M,) complex
        Conjugated normals of the lines in the odometry frame, times the `OrientedPoints.inverse_noise` of the points.
    error : (M,) float [m]
        Signed distances of the points from the lines, times the `OrientedPoints.inverse_noise` of the points.
    """

    frame: NDArray[np.intp]
    point: NDArray[np.intp]
    rotated_points: NDArray[np.complex128]
    normals: NDArray[np.complex128]
    error: NDArray[np.float64]


def confirm(window: KeyFrameWindow, pose: SE2, points: OrientedPoints, distance: float, scale: float,
            min_cosine: float) -> NDArray[np.float64]:
    """Rate how static points are: points on the lines of key frames from other positions are static.

    Parameters
    ----------
    window : KeyFrameWindow
    pose : SE2
        Pose of the scan in the odometry frame.
    points : OrientedPoints
        P points of the scan.
    distance : float [m]
        Least distance between the sensor and a key frame that is used.
    scale : float [m]
        Scale of the kernel of the distances between points and lines.
    min_cosine : float
        Least cosine of the angle between the normals of a point and of its line.

    Returns
    -------
    (P,) float
        Largest kernel value of each point over all key frames that are used, from 0 to 1.
    """
    confirmed = np.zeros(len(points))
    elsewhere = np.abs(window.poses.origins[:, 0] - complex(pose.x, pose.y)) > distance
    if elsewhere.any():
        lookup = np.tile(np.arange(len(points)), (len(window.frames), 1))
        pairs = look_up_pairs(window.fields, window.poses, pose, points, lookup, min_cosine)
        np.maximum.at(confirmed, pairs.point, kernel(pairs.error, scale) * elsewhere.take(pairs.frame))
    return confirmed


def look_up_correspondences(window: KeyFrameWindow, pose: SE2, points: OrientedPoints,
                            density: DensityParameters) -> Correspondences:
    """Find the lines of key frames on which the `points` of a scan lie if the scan is at `pose` (odometry frame).

    Points of high leverage are looked up in every key frame. If a scan has many other points, these are split into
    subsets: one subset is looked up in each key frame, and each subset in several key frames.
    """
    lookup = points_by_frame(high_leverage(points.normals), points.beams, len(window.frames),
                             density.max_points // _SUBSETS)
    pairs = look_up_pairs(window.fields, window.poses, pose, points, lookup, density.min_normal_cosine)
    weights = None if points.weights is None else points.weights.take(pairs.point)
    rows = linear_residuals(pairs.error, pairs.normals, pairs.rotated_points)
    return Correspondences(pose=pose, size=len(points), frame=pairs.frame, index=pairs.point,
                           rotated_points=pairs.rotated_points, rows=rows, weights=weights)


def look_up_pairs(stack: LikelihoodFieldStack, poses: FramePoses, pose: SE2, points: OrientedPoints,
                  lookup: NDArray[np.intp], min_cosine: float) -> Pairs:
    """Find the lines of key frame k on which the points ``lookup[k]`` lie if the scan is at `pose`."""
    rotation, origin = cmath.rect(1.0, pose.theta), complex(pose.x, pose.y)
    rotated_points = rotation * points.points
    at, row, nearest = stack.nearest((rotated_points + origin).take(lookup))
    index = lookup.take(at)
    normals = stack.normals.take(nearest) * poses.rotations.take(row)
    rotated_points = rotated_points.take(index)
    offset = normals * (rotated_points + (origin - poses.origins.take(row)))
    error, along = offset.real - stack.offsets.take(nearest), offset.imag - stack.along.take(nearest)
    kept = (normals * (rotation * points.normals).take(index)).real > min_cosine
    kept &= np.abs(along) <= stack.extents.take(nearest)
    pairs = Pairs(row[kept], index[kept], rotated_points[kept], normals[kept], error[kept])
    if points.inverse_noise is None:
        return pairs
    inverse_noise = points.inverse_noise.take(pairs.point)
    return pairs._replace(normals=pairs.normals * inverse_noise, error=pairs.error * inverse_noise)


def points_by_frame(in_every_frame: NDArray[np.bool_], beams: NDArray[np.intp], frame_count: int,
                    subset_size: int) -> NDArray[np.intp]:
    """Choose the points that are looked up in each key frame.

    The subset of a point depends on its beam only: one point more or less does not change the subsets of other points.

    Parameters
    ----------
    in_every_frame : (P,) bool
        Points that are looked up in every key frame.
    beams : (P,) int
        Beam of each point.
    frame_count : int
    subset_size : int
        Desired number of points per key frame, apart from those that are looked up in every key frame.

    Returns
    -------
    (frame_count, N) int
        Indices of points. Smaller subsets are padded to equal size by repeating their points.
    """
    always, others = in_every_frame.nonzero()[0], (~in_every_frame).nonzero()[0]
    count = max(min(frame_count // _MIN_FRAMES_PER_POINT, -(-len(others) // subset_size)), 1)
    subset_of_point = beams.take(others) % count
    subsets = [others[subset_of_point == k] for k in range(count)]
    size = max(map(len, subsets))
    padded = np.array([np.resize(each if len(each) else others, size) for each in subsets])
    chosen = np.empty((frame_count, len(always) + size), dtype=np.intp)
    chosen[:, :len(always)] = always
    chosen[:, len(always):] = padded[np.arange(frame_count) % count]
    return chosen


_MIN_FRAMES_PER_POINT = 3
"""Each point is looked up in at least this many key frames."""
_SUBSETS = 3
"""The size of a subset is about `density.max_points` divided by this number."""
