# SPDX-License-Identifier: Apache-2.0
"""Types of the compiled steps: those of the reference."""
from ..features.extraction import extract_from_returns as extract_from_returns
from ..features.free_space import build_free_space_profile as build_free_space_profile
from ..features.likelihood_field import build_likelihood_field as build_likelihood_field
from ..features.normals import estimate_normals as estimate_normals
from ..features.oriented_points import build_oriented_points as build_oriented_points
from ..features.oriented_points import high_leverage as high_leverage
from ..features.oriented_points import leverage as leverage
from ..features.point_sequence import point_sequence as point_sequence
from ..features.range_noise import estimate_noise as estimate_noise
from ..features.range_noise import estimate_noise_ratio as estimate_noise_ratio
from ..features.ring_band import ring_band_filter as ring_band_filter
from ..features.segments import extract_segments as extract_segments
from ..features.small_objects import find_small_objects as find_small_objects
from ..features.small_objects import with_poles as with_poles
from ..odometry.mapping.correspondences import align as align
from ..odometry.mapping.correspondences import weighted_by_agreement as weighted_by_agreement
from ..odometry.mapping.dynamic_points import beside as beside
from ..odometry.mapping.dynamic_points import detached_points as detached_points
from ..odometry.mapping.dynamic_points import dynamic_points as dynamic_points
from ..odometry.mapping.dynamic_points import information_ratio as information_ratio
from ..odometry.mapping.key_frame_window import confirm as confirm
from ..odometry.mapping.key_frame_window import look_up_correspondences as look_up_correspondences
from ..odometry.mapping.key_frame_window import look_up_pairs as look_up_pairs
from ..odometry.mapping.key_frame_window import points_by_frame as points_by_frame
from ..odometry.mapping.local_map import newest_in_cell as newest_in_cell
from ..odometry.mapping.local_map import older_map_points as older_map_points
from ..odometry.mapping.scan_to_map import align_to_map as align_to_map
from ..odometry.mapping.scan_to_map import alignment_uncertainty as alignment_uncertainty
from ..odometry.models.covariance import propagate_errors as propagate_errors
from ..registration.confidence.evidence import collect_evidence as collect_evidence
from ..registration.confidence.model import log_odds as log_odds
from ..registration.degeneracy import search_degenerate_direction as search_degenerate_direction
from ..registration.pipeline import near_motions as near_motions
from ..registration.point_to_line import fit as fit
from ..registration.rotation import estimate_rotations as estimate_rotations
from ..registration.rotation import pair_weights as pair_weights
from ..registration.selection import polish_best as polish_best
from ..registration.selection import rank_by_density as rank_by_density
from ..registration.status import assess as assess
from ..registration.status import find_rivals as find_rivals
from ..registration.translation import estimate_translations as estimate_translations
from ..registration.uncertainty import match_covariance as match_covariance
from ..registration.uncertainty import uncertainty as uncertainty

SOURCE_HASH: str
STEPS: tuple[str, ...]
