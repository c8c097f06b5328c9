# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Clusters of translations by DBSCAN (Ester et al., KDD 1996): components of the core samples, and their borders."""
import numpy as np

from libc.math cimport INFINITY

from ...geometry.ordering cimport sort_stably
from ...geometry.plane cimport length_of


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
    return np.asarray(cluster_translations(samples, rotation, eps, min_samples, 0.0))


cdef Py_ssize_t[::1] cluster_translations(const double complex[::1] samples, const Py_ssize_t[::1] rotation, double eps,
                                          Py_ssize_t min_samples, double max_width):
    """Return the cluster of each sample; those wider than `max_width` are clustered again with half the radius.

    Samples of each rotation are moved along x, so that those of different rotations are no neighbours.
    """
    cdef Py_ssize_t size = samples.shape[0], level, k, label, count, offset = 0
    cdef double low = INFINITY, high = -INFINITY, squared = max_width * max_width
    cdef Py_ssize_t[:, ::1] work = np.empty((4, size), np.intp)
    cdef Py_ssize_t[::1] order = work[0], parent = work[1], rank = work[2], labels = work[3]
    cdef unsigned char[::1] chosen = np.ones(size, np.uint8), core = chosen
    cdef double[:, ::1] sums = np.empty((4, size))
    cdef double[::1] x = sums[3]
    if min_samples > 1:
        core = np.empty(size, np.uint8)
    with nogil:
        for k in range(size):
            low, high = min(low, samples[k].real), max(high, samples[k].real)
        for k in range(size):
            x[k] = samples[k].real + (2.0 * eps + high - low) * rotation[k]
        sort_stably(x, order, parent)
        for level in range(2):
            if min_samples > 1:
                flag_core(samples, x, order, chosen, eps * 0.5 ** level, min_samples, rank, core)
            connect(samples, x, order, core, parent, eps * 0.5 ** level)
            if min_samples > 1:
                add_borders(samples, x, order, core, eps * 0.5 ** level, parent, chosen, labels)
            # Numbered by their first core samples, which are the roots.
            count = 0
            for k in range(size):
                if core[k] and root_of(parent, k) == k:
                    rank[k] = count
                    count += 1
            for k in range(size):
                if chosen[k]:
                    labels[k] = offset + rank[root_of(parent, k)]
            if level or max_width <= 0.0:
                break
            flag_chains(samples, labels, offset, count, squared, chosen, sums)
            offset += count
    return labels


cdef inline Py_ssize_t root_of(Py_ssize_t[::1] parent, Py_ssize_t k) except -1 nogil:
    """Return the first sample of the component of a sample, and shorten the way to it."""
    while parent[k] != k:
        parent[k] = parent[parent[k]]
        k = parent[k]
    return k


cdef int connect(const double complex[::1] samples, const double[::1] x, const Py_ssize_t[::1] order,
                 const unsigned char[::1] chosen, Py_ssize_t[::1] parent, double eps) except -1 nogil:
    """Connect the chosen samples at most `eps` [m] apart: along x in ascending order."""
    cdef Py_ssize_t size = samples.shape[0], i, j, one, two
    for i in range(size):
        parent[i] = i
    for i in range(size):
        if not chosen[order[i]]:
            continue
        for j in range(i + 1, size):
            if x[order[j]] > x[order[i]] + eps:
                break
            if chosen[order[j]] and are_near(samples, x, order[i], order[j], eps):
                one, two = root_of(parent, order[i]), root_of(parent, order[j])
                parent[max(one, two)] = min(one, two)
    return 0


cdef inline bint are_near(const double complex[::1] samples, const double[::1] x, Py_ssize_t one, Py_ssize_t two,
                          double eps) except -1 nogil:
    """Whether two samples are at most `eps` [m] apart."""
    cdef double dx = x[one] - x[two], dy = samples[one].imag - samples[two].imag
    return dx * dx + dy * dy <= eps * eps


cdef int flag_core(const double complex[::1] samples, const double[::1] x, const Py_ssize_t[::1] order,
                   const unsigned char[::1] chosen, double eps, Py_ssize_t min_samples, Py_ssize_t[::1] neighbours,
                   unsigned char[::1] core) except -1 nogil:
    """Flag those of the chosen samples with at least `min_samples` neighbours, themselves included."""
    cdef Py_ssize_t size = samples.shape[0], i, j
    for i in range(size):
        neighbours[i] = chosen[i]
    for i in range(size):
        if not chosen[order[i]]:
            continue
        for j in range(i + 1, size):
            if x[order[j]] > x[order[i]] + eps:
                break
            if chosen[order[j]] and are_near(samples, x, order[i], order[j], eps):
                neighbours[order[i]] += 1
                neighbours[order[j]] += 1
    for i in range(size):
        core[i] = neighbours[i] >= min_samples
    return 0


cdef int add_borders(const double complex[::1] samples, const double[::1] x, const Py_ssize_t[::1] order,
                     const unsigned char[::1] core, double eps, Py_ssize_t[::1] parent, unsigned char[::1] chosen,
                     Py_ssize_t[::1] labels) except -1 nogil:
    """Add border samples to the first component within `eps`; the other samples are noise, not chosen."""
    cdef Py_ssize_t size = samples.shape[0], i, j, border, inner
    for i in range(size):
        for j in range(i + 1, size):
            if x[order[j]] > x[order[i]] + eps:
                break
            border, inner = order[i], order[j]
            if core[border]:
                border, inner = inner, border
            if chosen[border] and not core[border] and core[inner] and are_near(samples, x, border, inner, eps):
                inner = root_of(parent, inner)
                if parent[border] == border or inner < parent[border]:
                    parent[border] = inner
    for i in range(size):
        if chosen[i] and not core[i] and parent[i] == i:
            labels[i], chosen[i] = NOISE, False
    return 0


cdef int flag_chains(const double complex[::1] samples, const Py_ssize_t[::1] labels, Py_ssize_t offset,
                     Py_ssize_t count, double max_variance, unsigned char[::1] chosen,
                      double[:, ::1] sums) except -1 nogil:
    """Keep those samples chosen whose cluster has a variance above `max_variance` [m^2]."""
    cdef Py_ssize_t k, at
    cdef double off
    for at in range(count):
        sums[0, at] = sums[1, at] = sums[2, at] = 0.0
    for k in range(samples.shape[0]):
        if chosen[k]:
            at = labels[k] - offset
            sums[0, at] += samples[k].real
            sums[1, at] += samples[k].imag
            sums[2, at] += 1.0
    for at in range(count):
        sums[0, at], sums[1, at] = sums[0, at] / sums[2, at], sums[1, at] / sums[2, at]
        sums[2, at] *= -max_variance
    for k in range(samples.shape[0]):
        if chosen[k]:
            at = labels[k] - offset
            off = length_of(samples[k].real - sums[0, at], samples[k].imag - sums[1, at])
            sums[2, at] += off * off
    for k in range(samples.shape[0]):
        chosen[k] = chosen[k] and sums[2, labels[k] - offset] > 0.0
    return 0
