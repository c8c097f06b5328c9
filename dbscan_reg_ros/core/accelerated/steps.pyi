# SPDX-License-Identifier: Apache-2.0
"""Types of the compiled steps."""
from collections.abc import Sequence

from ..features.likelihood_field import LikelihoodField
from ..features.oriented_points import OrientedPoints
from ..features.records import Features, Segments
from ..geometry.array_types import BoolArray, ComplexArray, FloatArray, IntArray
from ..geometry.se2 import SE2
from ..odometry.mapping.correspondences import Correspondences, Pairs, PosePrior
from ..odometry.mapping.key_frame import KeyFrame
from ..odometry.mapping.key_frame_window import FramePoses, FreeSpaceStack, KeyFrameWindow, LikelihoodFieldStack
from ..odometry.mapping.scan_to_map import InitialAlignment
from ..odometry.models.covariance import PoseMeasurement
from ..parameters.registration import (
    DecisionParameters,
    DensityParameters,
    RefinementParameters,
    RotationParameters,
    TranslationParameters,
)
from ..parameters.tree import Parameters
from ..registration.hypotheses import Assessment, Candidates, Ranking, Rotations, Translations
from ..registration.point_to_line import Alignment, Fit
from ..registration.records import Evidence, Prior
from ..registration.search import Problem
from ..registration.uncertainty import Observability, Residuals

def fit(
    candidates: FloatArray, points: OrientedPoints, field: LikelihoodField, min_normal_cosine: float
) -> Fit: ...
def refine(
    candidates: FloatArray, alignment: Alignment, scales: Sequence[float]
) -> tuple[FloatArray, FloatArray]: ...
def polish(
    candidate: FloatArray, found: Fit, points: OrientedPoints, refinement: RefinementParameters
) -> tuple[FloatArray, Fit]: ...
def pair_weights(reference: Segments, current: Segments, parameters: RotationParameters) -> FloatArray: ...
def estimate_rotations(
    reference: Segments, current: Segments, weights: FloatArray, parameters: RotationParameters
) -> Rotations: ...
def k_distances(samples: FloatArray, k: int) -> FloatArray: ...
def dbscan_circle(samples: FloatArray, eps: float, min_samples: int, period: float) -> IntArray: ...
def dbscan_plane(samples: ComplexArray, eps: float, min_samples: int) -> IntArray: ...
def estimate_translations(
    reference: Segments,
    current: Segments,
    rotations: Rotations,
    weights: FloatArray,
    parameters: TranslationParameters,
) -> Translations: ...
def near_motions(problem: Problem, prior: Prior) -> FloatArray: ...
def scores(problem: Problem, candidates: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]: ...
def reverse_conflicts(problem: Problem, candidates: FloatArray) -> FloatArray: ...
def rank_by_density(problem: Problem, candidates: Candidates, min_score: float) -> Ranking: ...
def polish_best(problem: Problem, fine: Ranking) -> Ranking: ...
def search_degenerate_direction(candidates: FloatArray, angles: FloatArray, problem: Problem) -> FloatArray: ...
def uncertainty(
    candidate: FloatArray, found: Fit, points: OrientedPoints, noise: float, p: Parameters
) -> tuple[FloatArray, Observability]: ...
def match_covariance(
    residuals: Residuals,
    parameters: DecisionParameters,
    theta: float,
    latest_degenerate: bool = False,
    rotation_unobservable: bool = False,
) -> tuple[FloatArray, Observability]: ...
def collect_evidence(
    candidates: FloatArray,
    fits: Fit,
    weak: Sequence[float],
    reference: Features,
    current: Features,
    parameters: Parameters,
) -> list[Evidence]: ...
def evidence_terms(evidence: Evidence) -> tuple[float, ...]: ...
def log_odds(evidence: Evidence, prior: Prior | None = None, candidate: FloatArray | None = None) -> float: ...
def assess(problem: Problem, fine: Ranking) -> Assessment: ...
def find_rivals(
    candidates: FloatArray, direction: float | None, parameters: DecisionParameters
) -> BoolArray: ...
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
