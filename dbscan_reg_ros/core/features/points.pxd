# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
cdef const double[::1] given_or_ones(values, Py_ssize_t size)
