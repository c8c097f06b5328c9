# SPDX-License-Identifier: Apache-2.0
"""Key-frame window: the latest key frames, their lookup tables and the local map."""
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..features.records import Features
from ..geometry.se2 import SE2
from .key_frame import KeyFrame
from .local_map import older_map_points
from .lookup import Slots


class KeyFrameWindow:
    """The latest key frames in order of time; immutable.

    Parameters
    ----------
    frames : sequence of KeyFrame
        At least one.

    Attributes
    ----------
    slots : Slots
        What the look-up of points reads of the key frames.
    sensors : frozenset of str
        Names of their sensors.
    """

    def __init__(self, frames: Sequence[KeyFrame]):
        self.frames = tuple(frames)
        self.slots = Slots(self.frames)
        self._local_maps: dict[KeyFrame, Features] = {}
        self._parts: dict[tuple[KeyFrame, ...], KeyFrameWindow] = {}
        self.sensors = frozenset(frame.sensor.name for frame in self.frames)

    @property
    def latest(self) -> KeyFrame:
        """The latest key frame of any sensor."""
        return self.frames[-1]

    def frames_of(self, sensor: str) -> tuple[KeyFrame, ...]:
        """Return the key frames of a `sensor`, the latest last; if it has none, the key frames of all sensors."""
        if len(self.sensors) == 1:
            return self.frames
        return tuple(frame for frame in self.frames if frame.sensor.name == sensor) or self.frames

    def local_map_of(self, sensor: str) -> Features:
        """Return the features of the latest key frame of a `sensor`, completed by points of other key frames.

        Points are taken from all key frames whose pose was constrained, also from key frames of other sensors.
        """
        latest = self.frames_of(sensor)[-1]
        if latest not in self._local_maps:
            others = [frame for frame in self.frames if frame is not latest and frame.constrained]
            points = others and older_map_points(others, latest, latest.features.density)
            self._local_maps[latest] = latest.features.with_map_points(points) if points else latest.features
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


def latest_frames(frames: Sequence[KeyFrame], size: int) -> Sequence[KeyFrame]:
    """Return the latest `size` x (number of sensors) key frames."""
    return frames[-size * len({frame.sensor.name for frame in frames}):]
