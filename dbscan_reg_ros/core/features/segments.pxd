# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
from .records cimport Segments


cdef Segments extract_segments(const double complex[::1] points, const unsigned char[::1] breaks,
                               const double[:, ::1] moments, const double[::1] radius, const Py_ssize_t[::1] beams,
                               const double[::1] noise, parameters)
