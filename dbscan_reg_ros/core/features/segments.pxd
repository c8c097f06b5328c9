# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
from .records cimport Segments
from .surfaces cimport Surfaces


cdef Segments extract_segments(const Surfaces *surfaces, const double *noise, parameters)
