# SPDX-License-Identifier: Apache-2.0
"""Types of the compiled steps."""
from collections.abc import Sequence

from ..features.oriented_points import OrientedPoints
from ..features.records import Features
from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.se2 import SE2
from ..odometry.mapping.correspondences import Correspondences, Pairs, PosePrior
from ..odometry.mapping.key_frame import KeyFrame
from ..odometry.mapping.key_frame_window import FramePoses, FreeSpaceStack, KeyFrameWindow, LikelihoodFieldStack
from ..odometry.mapping.scan_to_map import InitialAlignment
from ..odometry.models.covariance import PoseMeasurement
from ..parameters.registration import DensityParameters
from ..parameters.tree import Parameters
from ..registration.confidence.evidence import collect_evidence as collect_evidence
from ..registration.confidence.model import log_odds as log_odds
from ..registration.degeneracy import search_degenerate_direction as search_degenerate_direction
from ..registration.pipeline import near_motions as near_motions
from ..registration.point_to_line import fit as fit
from ..registration.records import Prior
from ..registration.rotation import estimate_rotations as estimate_rotations
from ..registration.rotation import pair_weights as pair_weights
from ..registration.selection import polish_best as polish_best
from ..registration.selection import rank_by_density as rank_by_density
from ..registration.status import assess as assess
from ..registration.status import find_rivals as find_rivals
from ..registration.translation import estimate_translations as estimate_translations
from ..registration.uncertainty import Observability
from ..registration.uncertainty import match_covariance as match_covariance
from ..registration.uncertainty import uncertainty as uncertainty

STEPS: tuple[str, ...]

def weighted_by_agreement(
    correspondences: Correspondences, own: Correspondences, is_own: BoolArray, scale: float, noise: float
) -> Correspondences: ...
def align(
    correspondences: Correspondences, start: SE2, prior: PosePrior, scales: Sequence[float], damping: float
) -> SE2: ...
def align_to_map(
    window: KeyFrameWindow,
    features: Features,
    initial: InitialAlignment,
    prior: PosePrior,
    p: Parameters,
    coarse: KeyFrameWindow | None = None,
) -> tuple[SE2, Correspondences]: ...
def alignment_uncertainty(
    features: Features, pose: SE2, correspondences: Correspondences, initial: InitialAlignment, p: Parameters
) -> tuple[FloatArray, Observability]: ...
def look_up_correspondences(
    window: KeyFrameWindow, pose: SE2, points: OrientedPoints, density: DensityParameters
) -> Correspondences: ...
def look_up_pairs(
    stack: LikelihoodFieldStack,
    poses: FramePoses,
    pose: SE2,
    points: OrientedPoints,
    lookup: IntArray,
    min_cosine: float,
) -> Pairs: ...
def points_by_frame(
    in_every_frame: BoolArray, beams: IntArray, frame_count: int, subset_size: int
) -> IntArray: ...
def confirm(
    window: KeyFrameWindow, pose: SE2, points: OrientedPoints, distance: float, scale: float, min_cosine: float
) -> FloatArray: ...
def dynamic_points(
    points: OrientedPoints, pose: SE2, free_space: FreeSpaceStack, margin: float, static: BoolArray
) -> BoolArray: ...
def beside(points: OrientedPoints, dynamic: BoolArray, margin: float) -> BoolArray: ...
def detached_points(points: OrientedPoints, size: float, margin: float, closed: bool) -> BoolArray: ...
def information_ratio(points: OrientedPoints, chosen: IntArray) -> float: ...
def older_map_points(
    older: Sequence[KeyFrame], latest: KeyFrame, density: DensityParameters
) -> OrientedPoints: ...
def newest_in_cell(
    points: ComplexArray, age_rank: IntArray, latest: ComplexArray, cell_size: float
) -> BoolArray: ...
def propagate_errors(
    joint: FloatArray, step: SE2, interval: float, prior: Prior, measurement: PoseMeasurement
) -> FloatArray: ...
