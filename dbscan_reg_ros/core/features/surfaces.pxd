# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
cdef struct BreakLimits:
    # Distance beyond which two neighbouring beams are apart: per range, and by noise [m]; widest gap [beams].
    double factor, margin
    Py_ssize_t max_gap


cdef BreakLimits break_limits(double increment, double noise, parameters) except *
cdef bint is_break(double complex first, double complex second, Py_ssize_t gap, BreakLimits *limits) noexcept nogil
cdef int mark_breaks(const double complex[::1] points, const Py_ssize_t[::1] beams, BreakLimits *limits,
                     unsigned char[::1] broken) except -1 nogil
cdef int sum_moments(const double complex[::1] points, double[:, ::1] total) except -1 nogil
cdef int fit_normals(const double complex[::1] points, const unsigned char[::1] breaks, const double[:, ::1] moments,
                     const double[::1] noise, double increment, parameters, double complex[::1] normals) except -1
