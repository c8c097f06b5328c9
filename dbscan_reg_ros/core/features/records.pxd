# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
"""Typed access to `Segments` and `Features`."""
from .oriented_points cimport OrientedPoints


cdef enum:
    # `EndKind` of the end of a segment.
    KIND_CORNER = 0
    KIND_FREE = 1
    KIND_OCCLUSION = 2


cdef class Segments:
    cdef readonly object start, end, direction, length, sigma_direction, sigma_offset, kinds, beams
    cdef object _fixed_ends
    cdef dict __dict__


cdef class Features:
    cdef readonly object measured, twist, points, beams, breaks, normals, density, weights
    cdef readonly Segments segments
    cdef readonly double noise, noise_ratio
    cdef readonly bint scattered
    cdef readonly OrientedPoints poles, map_points
    # Made when first asked for.
    cdef OrientedPoints _wall_points, _oriented_points, _sampled_points
    cdef object _scan, _leverage, _isolated, _free_space, _likelihood_field

    cdef OrientedPoints oriented(self)
    cdef OrientedPoints sampled(self)
    cdef Features copied(self)
    cdef Features with_points_of(self, normals, OrientedPoints poles, weights, double noise_ratio)
