# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
cdef double TYPICAL

cpdef double estimate_noise(const double[::1] ranges, limits) except -1.0
cpdef double estimate_noise_ratio(const double complex[::1] points, const double[::1] ranges,
                                  const Py_ssize_t[::1] beams, limits) except -1.0
cdef int write_range_noise(const double[::1] radius, double noise, double ratio, double[::1] result) except -1 nogil
