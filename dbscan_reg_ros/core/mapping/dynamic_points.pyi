# SPDX-License-Identifier: Apache-2.0
"""Dynamic points (people, doors, robots), which lie in free space of key frames, and movable objects."""
from ..features.oriented_points import OrientedPoints
from ..features.records import Features
from ..geometry.array_types import BoolArray, FloatArray, IntArray
from ..geometry.se2 import SE2
from ..parameters.tree import Parameters
from .key_frame_window import KeyFrameWindow

def without_dynamic_points(
    features: Features, pose: SE2, window: KeyFrameWindow, parameters: Parameters, sensor: str = ''
) -> Features: ...
def dynamic_points(
    points: OrientedPoints, pose: SE2, window: KeyFrameWindow, frames: int, margin: float, static: BoolArray
) -> BoolArray: ...
def detached_points(points: OrientedPoints, size: float, margin: float, closed: bool) -> FloatArray: ...
def beside(points: OrientedPoints, dynamic: BoolArray, margin: float) -> BoolArray: ...
def information_ratio(points: OrientedPoints, chosen: IntArray) -> float: ...
