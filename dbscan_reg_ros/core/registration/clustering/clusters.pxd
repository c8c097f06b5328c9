# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Clusters of translations by DBSCAN (Ester et al., KDD 1996): components of the core samples, and their borders."""


cdef enum:
    # The label of a sample that belongs to no cluster.
    NOISE = -1


cdef Py_ssize_t[::1] cluster_translations(const double complex[::1] samples, const Py_ssize_t[::1] rotation, double eps,
                                          Py_ssize_t min_samples)
