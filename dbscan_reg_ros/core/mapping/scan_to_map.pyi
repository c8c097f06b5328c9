# SPDX-License-Identifier: Apache-2.0
"""Scan-to-map alignment: registers a scan to all key frames at once, and estimates covariance and observability."""
from collections.abc import Sequence

from ..features.oriented_points import OrientedPoints
from ..features.records import Features
from ..geometry.array_types import BoolArray, FloatArray
from ..geometry.se2 import SE2
from ..parameters.registration import DensityParameters
from ..parameters.tree import Parameters
from ..registration.residuals import Observability
from .correspondences import Correspondences, PosePrior
from .key_frame_window import KeyFrameWindow
from .observability import InitialAlignment

def align_to_map(
    window: KeyFrameWindow,
    features: Features,
    initial: InitialAlignment,
    prior: PosePrior,
    p: Parameters,
    coarse: KeyFrameWindow | None = None,
) -> tuple[SE2, Correspondences]: ...
def look_up_correspondences(
    window: KeyFrameWindow, pose: SE2, points: OrientedPoints, density: DensityParameters
) -> Correspondences: ...
def align(
    correspondences: Correspondences, start: SE2, prior: PosePrior, scales: Sequence[float], damping: float
) -> SE2: ...
def weighted_by_agreement(
    correspondences: Correspondences, own: Correspondences, is_own: BoolArray, scale: float, noise: float
) -> Correspondences: ...
def alignment_uncertainty(
    features: Features, pose: SE2, correspondences: Correspondences, initial: InitialAlignment, p: Parameters
) -> tuple[FloatArray, Observability]: ...
