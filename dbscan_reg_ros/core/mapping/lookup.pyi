# SPDX-License-Identifier: Apache-2.0
"""Look-up of points in all key frames at once."""
from ..features.oriented_points import OrientedPoints
from ..geometry.array_types import BoolArray, FloatArray, IntArray
from ..geometry.se2 import SE2
from .correspondences import Pairs
from .key_frame_window import FramePoses, KeyFrameWindow, LikelihoodFieldStack

def look_up_pairs(
    stack: LikelihoodFieldStack,
    poses: FramePoses,
    pose: SE2,
    points: OrientedPoints,
    lookup: IntArray,
    min_cosine: float,
) -> Pairs: ...
def confirm(
    window: KeyFrameWindow, pose: SE2, points: OrientedPoints, distance: float, scale: float, min_cosine: float
) -> FloatArray: ...
def points_by_frame(
    in_every_frame: BoolArray, beams: IntArray, frame_count: int, subset_size: int
) -> IntArray: ...
