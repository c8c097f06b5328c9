# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
cdef covariance_of(const double[::1] error, const double[::1] weight, const double[:, ::1] rows,
                   const double[:, ::1] own, double noise, parameters, double theta, bint latest_degenerate,
                   bint rotation_unobservable)
cdef int write_parallel(double angle, const double[:, ::1] information, double few, double *motion) except -1
cdef bint is_corridor_like(const double[:, ::1] information, double angle) except -1
