# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
cdef double TYPICAL

cdef double noise_of(const double *radius, Py_ssize_t size, limits, double *bend) except -1.0
cdef double noise_ratio_of(const double *x, const double *y, const double *ranges, Py_ssize_t size,
                           limits) except -1.0
cdef void write_range_noise(const double *radius, Py_ssize_t size, double noise, double ratio,
                            double *result) noexcept nogil
