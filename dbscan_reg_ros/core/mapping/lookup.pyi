# SPDX-License-Identifier: Apache-2.0
"""Key frames as the look-up of points reads them, and the look-up of a scan in all of them."""
from collections.abc import Sequence
from typing import final

from ..features.oriented_points import OrientedPoints
from ..geometry.array_types import BoolArray, FloatArray, IntArray
from ..geometry.se2 import SE2
from ..parameters.registration import DensityParameters
from .correspondences import Correspondences
from .key_frame import KeyFrame
from .key_frame_window import KeyFrameWindow

@final
class Slots:
    def __new__(cls, frames: Sequence[KeyFrame]) -> Slots: ...

def look_up_correspondences(
    window: KeyFrameWindow, pose: SE2, points: OrientedPoints, density: DensityParameters
) -> Correspondences: ...
def look_up_subsets(
    in_every_frame: BoolArray, beams: IntArray, frame_count: int, subset_size: int
) -> IntArray: ...
def confirm(
    window: KeyFrameWindow,
    pose: SE2,
    points: OrientedPoints,
    distance: float,
    scale: float,
    density: DensityParameters,
) -> FloatArray: ...
