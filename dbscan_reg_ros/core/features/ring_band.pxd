# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
cdef int filter_points(double *x, double *y, Py_ssize_t beams, double noise, parameters, Py_ssize_t *outcome) except -1
