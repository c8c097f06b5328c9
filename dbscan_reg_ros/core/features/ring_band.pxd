# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
cdef int filter_points(double complex[::1] place, double noise, parameters, Py_ssize_t[::1] outcome) except -1
