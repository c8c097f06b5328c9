# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Compiled steps: same names, arguments and results as the functions of the numpy reference.

Arrays come in and go out; loops run over typed views, without the interpreter. Every index is checked.
"""
import math
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from libc.math cimport INFINITY, M_PI, NAN, atan2, copysign, cos, exp, fabs, floor, fmod, isfinite, isnan, log, log1p
from libc.math cimport rint, sin, sqrt
from libc.stdlib cimport free, labs, malloc

from ..errors import ScanError
from ..features import free_space as free_space_steps
from ..features import likelihood_field as likelihood_field_steps
from ..features import normals as normal_steps
from ..features import oriented_points as oriented_steps
from ..features import range_noise as range_noise_steps
from ..features import ring_band as ring_band_steps
from ..features import segments as segment_steps
from ..features import small_objects as small_object_steps
from ..features.free_space import FreeSpaceProfile
from ..features.likelihood_field import LikelihoodField
from ..features.oriented_points import OrientedPoints
from ..features.point_sequence import PointSequence
from ..features.records import EndKind, Features, Segments
from ..features.small_objects import SmallObjects
from ..geometry import tolerance
from ..geometry.se2 import SE2
from ..odometry.mapping import dynamic_points as dynamic_steps
from ..odometry.mapping import key_frame_window as window_steps
from ..odometry.mapping import local_map as local_map_steps
from ..odometry.mapping import scan_to_map as map_steps
from ..odometry.mapping.correspondences import Correspondences, PosePrior
from ..odometry.mapping.key_frame_window import Pairs
from ..registration import degeneracy as degeneracy_steps
from ..registration import pipeline as pipeline_steps
from ..registration import rotation as rotation_steps
from ..registration import scoring as scoring_steps
from ..registration import selection as selection_steps
from ..registration import translation as translation_steps
from ..registration import uncertainty as uncertainty_steps
from ..registration.confidence import evidence as evidence_steps
from ..registration.confidence import model as model_steps
from ..registration.point_to_line import Fit
from ..registration.records import Evidence
from ..registration.rotation import Rotations
from ..registration.search import Ranking
from ..registration.status import Assessment
from ..registration.translation import Translations
from ..registration.uncertainty import Observability

cdef extern from *:
    """
    #ifndef DBSCAN_REG_SOURCE_HASH
    #define DBSCAN_REG_SOURCE_HASH "unknown"
    #endif
    """
    const char *DBSCAN_REG_SOURCE_HASH

SOURCE_HASH = DBSCAN_REG_SOURCE_HASH.decode()
"""Hash of the sources that this was built from."""

cdef double TINY = tolerance.TINY, ROUNDING = tolerance.ROUNDING, SAME = tolerance.SAME, SIGMAS = tolerance.SIGMAS

include "geometry.pxi"
include "features/ordering.pxi"
include "features/range_noise.pxi"
include "features/ring_band.pxi"
include "features/surfaces.pxi"
include "features/segments.pxi"
include "features/likelihood_field.pxi"
include "features/free_space.pxi"
include "features/leverage.pxi"
include "features/small_objects.pxi"
include "features/extraction.pxi"
include "registration/lookup.pxi"
include "registration/point_to_line.pxi"
include "registration/rotation.pxi"
include "registration/clusters.pxi"
include "registration/translation.pxi"
include "registration/scoring.pxi"
include "registration/ranking.pxi"
include "registration/degeneracy.pxi"
include "registration/uncertainty.pxi"
include "registration/evidence.pxi"
include "mapping/window.pxi"
include "mapping/correspondences.pxi"
include "mapping/scan_to_map.pxi"
include "mapping/dynamic_points.pxi"
include "mapping/local_map.pxi"
include "models/covariance.pxi"

STEPS = (
    'estimate_noise', 'estimate_noise_ratio', 'ring_band_filter', 'point_sequence', 'estimate_normals',
    'extract_segments', 'build_likelihood_field', 'build_free_space_profile',
    'leverage', 'high_leverage', 'find_small_objects', 'extract_from_returns', 'build_oriented_points',
    'fit', 'pair_weights', 'estimate_rotations', 'estimate_translations', 'near_motions', 'rank_by_density',
    'polish_best',
    'search_degenerate_direction', 'uncertainty', 'match_covariance', 'collect_evidence', 'log_odds', 'assess',
    'find_rivals',
    'look_up_pairs', 'points_by_frame', 'look_up_correspondences', 'weighted_by_agreement', 'align', 'align_to_map',
    'alignment_uncertainty',
    'confirm', 'dynamic_points', 'detached_points', 'beside', 'information_ratio', 'newest_in_cell',
    'older_map_points', 'with_poles',
    'propagate_errors',
)
"""Names of the steps."""
