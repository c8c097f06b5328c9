# SPDX-License-Identifier: Apache-2.0
"""Local map: the points of the latest key frame and the points of older key frames in its surroundings."""
from collections.abc import Sequence

from ..features.oriented_points import OrientedPoints
from ..parameters.registration import DensityParameters
from .key_frame import KeyFrame

def older_map_points(
    older: Sequence[KeyFrame], latest: KeyFrame, density: DensityParameters
) -> OrientedPoints: ...
