# SPDX-License-Identifier: Apache-2.0
"""Types of the compiled steps: those of the reference."""
from ..features.free_space import build_free_space_profile as build_free_space_profile
from ..features.likelihood_field import build_likelihood_field as build_likelihood_field
from ..features.normals import estimate_normals as estimate_normals
from ..features.oriented_points import leverage as leverage
from ..features.point_sequence import point_sequence as point_sequence
from ..features.range_noise import estimate_noise as estimate_noise
from ..features.range_noise import estimate_noise_ratio as estimate_noise_ratio
from ..features.ring_band import ring_band_filter as ring_band_filter
from ..features.segments import extract_segments as extract_segments
from ..odometry.mapping.correspondences import align as align
from ..odometry.mapping.correspondences import pair_weights_after as pair_weights_after
from ..odometry.mapping.dynamic_points import beside as beside
from ..odometry.mapping.dynamic_points import detached_points as detached_points
from ..odometry.mapping.dynamic_points import dynamic_points as dynamic_points
from ..odometry.mapping.key_frame_window import look_up_pairs as look_up_pairs
from ..odometry.mapping.key_frame_window import points_by_frame as points_by_frame
from ..odometry.mapping.local_map import newest_in_cell as newest_in_cell
from ..registration.point_to_line import fit as fit
from ..registration.point_to_line import next_step as next_step
from ..registration.point_to_line import polish as polish
from ..registration.point_to_line import refine as refine
from ..registration.rotation import estimate_rotations as estimate_rotations
from ..registration.rotation import pair_weights as pair_weights
from ..registration.scoring import reverse_violation as reverse_violation
from ..registration.scoring import score as score
from ..registration.translation import estimate_translations as estimate_translations
from ..registration.uncertainty import informations as informations

SOURCE_HASH: str
STEPS: tuple[str, ...]
