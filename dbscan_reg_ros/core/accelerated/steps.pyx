# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Compiled steps of the registration and of the map.

Arrays come in and go out; loops run over typed views, without the interpreter. Every index is checked.
"""
import math
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from libc.math cimport INFINITY, M_PI, NAN, atan2, copysign, cos, exp, fabs, floor, fmod, isfinite, isnan, log, log1p
from libc.math cimport rint, sin, sqrt
from libc.stdlib cimport free, labs, malloc

from ..features.oriented_points import OrientedPoints
from ..features.points import high_leverage, sample
from ..features.records import EndKind
from ..geometry import tolerance
from ..geometry.se2 import SE2
from ..odometry.mapping import scan_to_map as map_steps
from ..odometry.mapping.correspondences import Correspondences, Pairs, PosePrior
from ..registration import uncertainty as uncertainty_records
from ..registration.confidence import model as confidence_model
from ..registration.hypotheses import Assessment, Ranking, Rotations, Translations
from ..registration.point_to_line import Fit
from ..registration.records import Evidence
from ..registration.scoring import preselect
from ..registration.uncertainty import Observability

from ..features.points cimport given_or_ones
from ..geometry.ordering cimport first_largest, sort_stably, sort_up_to_rounding
from ..geometry.plane cimport bin_of, cross, distance, dot, length_of, modulus, rotated, wrap, wrapped

cdef double TINY = tolerance.TINY, SAME = tolerance.SAME, SIGMAS = tolerance.SIGMAS

include "geometry.pxi"
include "registration/lookup.pxi"
include "registration/point_to_line.pxi"
include "registration/clusters.pxi"
include "registration/rotation.pxi"
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
