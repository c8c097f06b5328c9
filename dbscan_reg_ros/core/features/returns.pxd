# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
cdef class Returns:
    cdef readonly object scan
    cdef readonly double noise
    cdef object limits, twist
    # Points of all beams (N,) complex; ranges and beams of the returns, and their number.
    cdef object places
    cdef const double[::1] ranges
    cdef const Py_ssize_t[::1] beams
    cdef Py_ssize_t count
