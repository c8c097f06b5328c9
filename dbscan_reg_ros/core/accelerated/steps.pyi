# SPDX-License-Identifier: Apache-2.0
"""Types of the compiled steps: those of the reference."""
from ..features.likelihood_field import build_likelihood_field as build_likelihood_field
from ..features.normals import estimate_normals as estimate_normals
from ..features.point_sequence import point_sequence as point_sequence
from ..features.range_noise import estimate_noise as estimate_noise
from ..features.range_noise import estimate_noise_ratio as estimate_noise_ratio
from ..features.ring_band import ring_band_filter as ring_band_filter
from ..features.segments import extract_segments as extract_segments
from ..registration.point_to_line import fit as fit
from ..registration.point_to_line import next_step as next_step
from ..registration.point_to_line import polish as polish
from ..registration.point_to_line import refine as refine
from ..registration.rotation import estimate_rotations as estimate_rotations
from ..registration.scoring import reverse_violation as reverse_violation
from ..registration.scoring import score as score
from ..registration.translation import estimate_translations as estimate_translations

SOURCE_HASH: str
STEPS: tuple[str, ...]
