# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
"""What the residuals of a registered scan constrain."""
from ..geometry.symmetric cimport Symmetric


cdef enum:
    # Rows of a table of residuals: errors [m] and weights; derivatives of the errors by x, y and theta, computed with
    # the normals of the lines, and with those of the points themselves.
    ERROR, WEIGHT, BY_X, BY_Y, BY_THETA, OWN_X, OWN_Y, OWN_THETA, ROWS


cdef struct Limits:
    # Numbers of `DecisionParameters`.
    double min_information, weak_prior, parallel_tolerance, covariance_scale, few_points_scale


cdef struct Uncertainty:
    # Covariance (3, 3) in the frame of the sensor [m, m, rad], by rows; and `Observability`.
    double[9] covariance
    double angle, weak, rotation


cdef Limits limits_of(parameters) except *
cdef Uncertainty estimate(const double[:, ::1] table, double noise, Limits *limits, double theta,
                          bint latest_degenerate, bint rotation_unobservable) noexcept nogil
cdef covariance_of(Uncertainty *found)
cdef double wall_direction(const double[:, ::1] table) noexcept nogil
cdef void make_walls_parallel(double[:, ::1] table, double angle) noexcept nogil
cdef void write_parallel(double angle, Symmetric *information, double min_information,
                         double *motion) noexcept nogil
cdef bint is_corridor_like(Symmetric *information, double angle) noexcept nogil
