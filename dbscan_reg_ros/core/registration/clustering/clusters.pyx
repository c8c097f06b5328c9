# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Clusters of translations by DBSCAN (Ester et al., KDD 1996): components of the core samples, and their borders."""
import numpy as np

from libc.math cimport INFINITY

from ...geometry.ordering cimport sort_stably


def dbscan_plane(const double complex[::1] samples, double eps, Py_ssize_t min_samples):
    """Cluster points of the plane by DBSCAN.

    Parameters
    ----------
    samples : (N,) complex array [m]
    eps : float [m]
    min_samples : int

    Returns
    -------
    (N,) int array
        Labels as of `dbscan_circle`.
    """
    cdef Py_ssize_t[::1] rotation = np.zeros(samples.shape[0], np.intp)
    return np.asarray(cluster_translations(samples, rotation, eps, min_samples))


cdef Py_ssize_t[::1] cluster_translations(const double complex[::1] samples, const Py_ssize_t[::1] rotation, double eps,
                                          Py_ssize_t min_samples):
    """Return the cluster of each sample.

    Samples of each rotation are moved along x, so that those of different rotations are no neighbours.
    """
    cdef Py_ssize_t size = samples.shape[0], k, count = 0
    cdef double low = INFINITY, high = -INFINITY
    cdef Py_ssize_t[:, ::1] work = np.empty((4, size), np.intp)
    cdef Py_ssize_t[::1] order = work[0], parent = work[1], rank = work[2], labels = work[3]
    cdef unsigned char[::1] core = np.ones(size, np.uint8)
    cdef double[::1] x = np.empty(size)
    with nogil:
        for k in range(size):
            low, high = min(low, samples[k].real), max(high, samples[k].real)
        for k in range(size):
            x[k] = samples[k].real + (2.0 * eps + high - low) * rotation[k]
        sort_stably(x, order, parent)
        if min_samples > 1:
            flag_core(samples, x, order, eps, min_samples, rank, core)
        connect(samples, x, order, core, parent, eps)
        if min_samples > 1:
            add_borders(samples, x, order, core, eps, parent)
        # Numbered by their first core samples, which are the roots; what has no core sample near it is noise.
        for k in range(size):
            rank[k] = NOISE
            if core[k] and root_of(parent, k) == k:
                rank[k] = count
                count += 1
        for k in range(size):
            labels[k] = rank[root_of(parent, k)]
    return labels


cdef inline Py_ssize_t root_of(Py_ssize_t[::1] parent, Py_ssize_t k) except -1 nogil:
    """Return the first sample of the component of a sample, and shorten the way to it."""
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


cdef int connect(const double complex[::1] samples, const double[::1] x, const Py_ssize_t[::1] order,
                 const unsigned char[::1] core, Py_ssize_t[::1] parent, double eps) except -1 nogil:
    """Connect the core samples at most `eps` [m] apart: along x in ascending order."""
    cdef Py_ssize_t size = samples.shape[0], i, j, one, two
    for i in range(size):
        parent[i] = i
    for i in range(size):
        if not core[order[i]]:
            continue
        for j in range(i + 1, size):
            if x[order[j]] > x[order[i]] + eps:
                break
            if core[order[j]] and are_near(samples, x, order[i], order[j], eps):
                one, two = root_of(parent, order[i]), root_of(parent, order[j])
                parent[max(one, two)] = min(one, two)
    return 0


cdef inline bint are_near(const double complex[::1] samples, const double[::1] x, Py_ssize_t one, Py_ssize_t two,
                          double eps) except -1 nogil:
    """Whether two samples are at most `eps` [m] apart."""
    cdef double dx = x[one] - x[two], dy = samples[one].imag - samples[two].imag
    return dx * dx + dy * dy <= eps * eps


cdef int flag_core(const double complex[::1] samples, const double[::1] x, const Py_ssize_t[::1] order, double eps,
                   Py_ssize_t min_samples, Py_ssize_t[::1] neighbours, unsigned char[::1] core) except -1 nogil:
    """Flag the samples with at least `min_samples` neighbours, themselves included."""
    cdef Py_ssize_t size = samples.shape[0], i, j
    neighbours[:] = 1
    for i in range(size):
        for j in range(i + 1, size):
            if x[order[j]] > x[order[i]] + eps:
                break
            if are_near(samples, x, order[i], order[j], eps):
                neighbours[order[i]] += 1
                neighbours[order[j]] += 1
    for i in range(size):
        core[i] = neighbours[i] >= min_samples
    return 0


cdef int add_borders(const double complex[::1] samples, const double[::1] x, const Py_ssize_t[::1] order,
                     const unsigned char[::1] core, double eps, Py_ssize_t[::1] parent) except -1 nogil:
    """Add border samples to the first component within `eps`."""
    cdef Py_ssize_t size = samples.shape[0], i, j, border, inner
    for i in range(size):
        for j in range(i + 1, size):
            if x[order[j]] > x[order[i]] + eps:
                break
            border, inner = order[i], order[j]
            if core[border]:
                border, inner = inner, border
            if not core[border] and core[inner] and are_near(samples, x, border, inner, eps):
                inner = root_of(parent, inner)
                if parent[border] == border or inner < parent[border]:
                    parent[border] = inner
    return 0
