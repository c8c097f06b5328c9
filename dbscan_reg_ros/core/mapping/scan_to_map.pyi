# SPDX-License-Identifier: Apache-2.0
"""Scan-to-map alignment: registers a scan to all key frames at once, and estimates covariance and observability."""
from ..features.records import Features
from ..geometry.array_types import FloatArray
from ..geometry.se2 import SE2
from ..parameters.tree import Parameters
from ..registration.residuals import Observability
from .correspondences import Correspondences
from .key_frame import KeyFrame
from .key_frame_window import KeyFrameWindow
from .records import InitialAlignment, PosePrior

def align_to_map(
    window: KeyFrameWindow,
    features: Features,
    initial: InitialAlignment,
    prior: PosePrior,
    p: Parameters,
    coarse: KeyFrameWindow | None = None,
) -> tuple[SE2, Correspondences]: ...
def alignment_uncertainty(
    features: Features, pose: SE2, found: Correspondences, initial: InitialAlignment, p: Parameters
) -> tuple[FloatArray, Observability]: ...
def expected_observability(
    window: KeyFrameWindow, key_frame: KeyFrame, features: Features, pose: SE2, p: Parameters
) -> Observability: ...
def information_along(features: Features, pose: SE2, angle: float, p: Parameters) -> float: ...
def sees_new_surface(
    features: Features, pose: SE2, found: Correspondences, angle: float, p: Parameters
) -> bool: ...
