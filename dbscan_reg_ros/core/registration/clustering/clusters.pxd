# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Clusters of translations by DBSCAN (Ester et al., KDD 1996): components of the core samples, and their borders."""


cdef enum:
    # The label of a sample that belongs to no cluster.
    NOISE = -1


cdef cluster_translations(const double complex[::1] samples, const Py_ssize_t[::1] rotation, double eps,
                          Py_ssize_t min_samples, double max_width)
cdef rank_translations(const double complex[::1] samples, const double[::1] sample_weight,
                       const Py_ssize_t[::1] rotation, const Py_ssize_t[::1] labels, const double[::1] phi)
