# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
cdef class Returns:
    cdef readonly object scan
    cdef readonly double noise
    cdef object limits, twist
    # x, y and range of each beam (3, N); number of returns.
    cdef double[:, ::1] place
    cdef Py_ssize_t count
