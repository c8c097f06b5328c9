# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Rotation hypotheses (section 2.2.1, Eq. 9)."""
import numpy as np

from ..hypotheses import Rotations

from libc.math cimport INFINITY, M_PI

from ...geometry.ordering cimport first_largest, sort_stably, sort_up_to_rounding
from ...geometry.plane cimport wrap, wrapped
from ..views cimport SegmentViews, views_of_segments
from .clusters cimport NOISE

# Limits [rad] of the neighbourhood radius from the k-dist graph: the step of a fine lidar, and twice that of a coarse one.
cdef double EPS_MIN = 0.005, EPS_MAX = 0.05


def pair_weights(reference, current, parameters):
    """Return the weight ``(n, m)`` of each pair: its shorter length [m], less where the directions are uncertain."""
    weights = weights_of(views_of_segments(reference), views_of_segments(current), parameters)
    return np.asarray(weights).reshape(len(reference), len(current))


cdef double[::1] weights_of(SegmentViews reference, SegmentViews current, parameters):
    """Return the `pair_weights` row by row."""
    cdef double width = parameters.max_width, variance
    cdef double[::1] weight = np.empty(reference.size * current.size)
    cdef Py_ssize_t i, j, k = 0
    for i in range(reference.size):
        for j in range(current.size):
            weight[k] = min(reference.length[i], current.length[j])
            if width:
                variance = reference.sigma[i] * reference.sigma[i] + current.sigma[j] * current.sigma[j]
                weight[k] /= 1.0 + variance / (width * width)
            k += 1
    return weight


def estimate_rotations(reference, current, weights, parameters):
    """Return the `Rotations` that `cluster_rotations` finds, as arrays.

    Parameters
    ----------
    reference, current : Segments
        n and m of them.
    weights : (n, m) array [m]
        From `pair_weights`.
    parameters : RotationParameters
    """
    cdef RotationClusters found = cluster_rotations(views_of_segments(reference), views_of_segments(current),
                                                    np.ravel(weights), parameters)
    shape = len(reference), len(current)
    return Rotations(np.asarray(found.phi), np.asarray(found.weight), np.asarray(found.difference).reshape(shape),
                     np.asarray(found.labels).reshape(shape), found.eps)


cdef class RotationClusters:
    """The `Rotations` of n x m pairs of segments, as views."""


cdef RotationClusters cluster_rotations(SegmentViews reference, SegmentViews current, const double[::1] weights,
                                        parameters):
    """Cluster all angle differences (Eq. 9) [rad] with DBSCAN; the heaviest clusters are the hypotheses."""
    cdef Py_ssize_t n = reference.size, m = current.size, size = n * m, i, j, k
    cdef double period = 2.0 * M_PI
    cdef RotationClusters found = RotationClusters.__new__(RotationClusters)
    # Clusters that are clustered again keep their numbers: there are at most twice as many as samples.
    cdef double[:, ::1] number = np.empty((6, 2 * size))
    cdef Py_ssize_t[:, ::1] index = np.empty((6, 2 * size), np.intp)
    cdef double[::1] samples = number[0, :size]
    cdef Py_ssize_t[::1] order = index[0, :size], labels = index[1, :size]
    for i in range(n):
        for j in range(m):
            samples[i * m + j] = wrapped(reference.direction[i] - current.direction[j], period)  # Eq. 9
    sort_stably(samples, order, labels)
    found.difference, found.eps = samples, parameters.eps
    if found.eps == 0.0 and size:
        for k in range(size):
            number[1, k] = samples[order[k]]
        found.eps = min(max(knee_of(ascending_k_distances(number[1, :size], max(parameters.min_samples - 1, 1))),
                            EPS_MIN), EPS_MAX)
    cluster_angles(samples, order, labels, period, found.eps, parameters.min_samples, parameters.max_width)
    rank_rotations(found, weights, labels, period, parameters.max_hypotheses, number[1:], index[2:])
    return found


cdef int rank_rotations(RotationClusters found, const double[::1] sample_weight, Py_ssize_t[::1] labels, double period,
                        Py_ssize_t most, double[:, ::1] total, Py_ssize_t[:, ::1] work) except -1 nogil:
    """Write weighted mean and weight of the heaviest clusters, and the rank of each sample's cluster; rows for work."""
    cdef const double[::1] samples = found.difference
    cdef Py_ssize_t size = samples.shape[0], k, at, clusters = 0, count = 0
    cdef double[::1] mean = total[3], weight = total[4]
    cdef Py_ssize_t[::1] used = work[0], order = work[1], rank = work[3]
    for k in range(size):
        clusters = max(clusters, labels[k] + 1)
    for at in range(clusters):
        total[0, at], total[1, at], total[2, at], used[at] = 0.0, 0.0, 0.0, 0
    for k in range(size):
        at = labels[k]
        if at != NOISE:
            # Negative: the heaviest come first.
            total[0, at] -= sample_weight[k]
            total[2, at], used[at] = samples[k], 1
    for k in range(size):
        at = labels[k]
        if at != NOISE:
            total[1, at] += sample_weight[k] * wrapped(samples[k] - total[2, at], period)
    sort_up_to_rounding(total[0, :clusters], order, work[2])
    for k in range(clusters):
        at, rank[order[k]] = order[k], -1
        # Numbers of clusters that were clustered again are unused.
        if used[at] and count < most:
            weight[count], rank[at] = -total[0, at], count
            mean[count] = wrap(total[2, at] + total[1, at] / weight[count])
            count += 1
    for k in range(size):
        labels[k] = NOISE if labels[k] == NOISE else rank[labels[k]]
    found.phi, found.weight, found.labels = mean[:count], weight[:count], labels
    return 0


def k_distances(samples, k):
    """Return the k-dist graph ``(N,)`` of numbers ``(N,)``: the distance of each to its k-th neighbour, largest first.

    A `k` above N - 1 counts as N - 1.
    """
    return ascending_k_distances(np.sort(samples), k)[::-1]


cdef ascending_k_distances(const double[::1] values, Py_ssize_t k):
    """Return the `k_distances` of ascending numbers, the largest last."""
    cdef Py_ssize_t size = values.shape[0], i, first
    distances = np.empty(size)
    cdef double[::1] graph = distances
    k = min(k, size - 1)
    for i in range(size):
        graph[i] = INFINITY
        # The k nearest and the sample itself are k + 1 in a row.
        for first in range(max(i - k, 0), min(i, size - 1 - k) + 1):
            graph[i] = min(graph[i], max(values[i] - values[first], values[first + k] - values[i]))
    distances.sort()
    return distances


cdef double knee_of(const double[::1] graph) except? -1.0:
    """Return the knee of an ascending k-dist graph: the distance that lies farthest below the chord between its ends."""
    cdef Py_ssize_t last = graph.shape[0] - 1, k
    if last < 2 or graph[last] <= graph[0]:
        return graph[0]
    cdef double[::1] off = np.empty(last + 1)
    for k in range(last + 1):
        off[k] = graph[last] + k * ((graph[0] - graph[last]) / <double> last) - graph[last - k]
    return graph[last - first_largest(off)]


def dbscan_circle(samples, double eps, Py_ssize_t min_samples, double period):
    """Cluster numbers on a circle by DBSCAN (Ester et al., KDD 1996): sort them, and cut at the gaps.

    Parameters
    ----------
    samples : (N,) array
        Numbers within one period, in its unit, as `eps`.
    eps : float
        Neighbours lie at most this far apart.
    min_samples : int
        A sample with at least as many neighbours, itself included, is a core sample.
    period : float

    Returns
    -------
    (N,) int array
        Cluster of each sample, -1 for none. Clusters are numbered in the order of their first core samples. A border
        sample belongs to the first cluster that has a core sample within `eps` of it.
    """
    cdef const double[::1] values = np.ascontiguousarray(samples)
    cdef Py_ssize_t[:, ::1] work = np.empty((2, values.shape[0]), np.intp)
    labels = np.empty(values.shape[0], np.intp)
    sort_stably(values, work[0], work[1])
    cluster_angles(values, work[0], labels, period, eps, min_samples, 0.0)
    return labels


cdef int cluster_angles(const double[::1] samples, const Py_ssize_t[::1] order, Py_ssize_t[::1] labels, double period,
                        double eps, Py_ssize_t min_samples, double max_width) except -1:
    """Cluster angles by DBSCAN, and clusters wider than `max_width` again with half the neighbourhood."""
    cdef Py_ssize_t size = samples.shape[0], level, at, count, chains, offset = 0, number = 0
    cdef Py_ssize_t[:, ::1] work = np.empty((4, size), np.intp)
    cdef Py_ssize_t[::1] chain = work[0], rank = work[1], place = work[2], neighbours = work[3]
    cdef unsigned char[::1] chosen = np.ones(size, np.uint8), core = chosen
    cdef double[:, ::1] limits = np.empty((3, size))
    cdef double[::1] first = limits[0], low = limits[1], high = limits[2]
    cdef double value
    if min_samples > 1:
        core = np.empty(size, np.uint8)
    with nogil:
        for level in range(2):
            if min_samples > 1:
                number = flag_core_angles(samples, order, chosen, period, eps * 0.5 ** level, min_samples, place,
                                          neighbours, core)
            chains = cut_at_gaps(samples, order, core, chain, period, eps * 0.5 ** level)
            for at in range(chains):
                rank[at], low[at], high[at] = NOISE, 0.0, 0.0
            count = 0
            for at in range(size):
                if core[at] and rank[chain[at]] == NOISE:
                    rank[chain[at]] = count
                    count += 1
            if min_samples > 1:
                add_border_angles(samples, place, number, core, rank, period, eps * 0.5 ** level, chain, chosen,
                                  labels)
            for at in range(size):
                if chosen[at]:
                    labels[at] = offset + rank[chain[at]]
                    first[chain[at]] = samples[at]
            if level or max_width <= 0.0:
                break
            for at in range(size):
                if chosen[at]:
                    value = wrapped(samples[at] - first[chain[at]], period)
                    low[chain[at]], high[chain[at]] = min(low[chain[at]], value), max(high[chain[at]], value)
            for at in range(size):
                chosen[at] = chosen[at] and high[chain[at]] - low[chain[at]] > max_width
            offset += count
    return 0


cdef Py_ssize_t flag_core_angles(const double[::1] samples, const Py_ssize_t[::1] order,
                                 const unsigned char[::1] chosen, double period, double eps, Py_ssize_t min_samples,
                                 Py_ssize_t[::1] place, Py_ssize_t[::1] neighbours,
                                 unsigned char[::1] core) except -1 nogil:
    """Flag core samples; write the indices of the chosen samples in ascending order to `place`, return their number."""
    cdef Py_ssize_t size = 0, k, n
    for k in range(samples.shape[0]):
        core[k] = False
        if chosen[order[k]]:
            place[size] = order[k]
            neighbours[size] = 1
            size += 1
    for k in range(size):
        for n in range(k + 1, k + size):
            if ahead(samples, place, k, n, size, period) > eps:
                break
            neighbours[k] += 1
            neighbours[n % size] += 1
    for k in range(size):
        # Where eps exceeds a quarter of the circle, some are neighbours both ways.
        core[place[k]] = min(neighbours[k], size) >= min_samples
    return size


cdef inline double ahead(const double[::1] samples, const Py_ssize_t[::1] place, Py_ssize_t k, Py_ssize_t n,
                         Py_ssize_t size, double period) except? -1.0 nogil:
    """Return how far the n-th of the samples in a row round the circle is ahead of the k-th, n at most k + size."""
    if n < size:
        return samples[place[n]] - samples[place[k]]
    return samples[place[n - size]] + period - samples[place[k]]


cdef int add_border_angles(const double[::1] samples, const Py_ssize_t[::1] place, Py_ssize_t size,
                           const unsigned char[::1] core, const Py_ssize_t[::1] rank, double period, double eps,
                           Py_ssize_t[::1] chain, unsigned char[::1] chosen, Py_ssize_t[::1] labels) except -1 nogil:
    """Write the chain of each border sample: the first one within `eps`; without one it is noise, not chosen."""
    cdef Py_ssize_t k, n, border, inner
    for k in range(size):
        if not core[place[k]]:
            chain[place[k]] = NOISE
    for k in range(size):
        for n in range(k + 1, k + size):
            if ahead(samples, place, k, n, size, period) > eps:
                break
            border, inner = place[k], place[n % size]
            if core[border] == core[inner]:
                continue
            if core[border]:
                border, inner = inner, border
            if chain[border] == NOISE or rank[chain[inner]] < rank[chain[border]]:
                chain[border] = chain[inner]
    for k in range(size):
        if chain[place[k]] == NOISE:
            labels[place[k]], chosen[place[k]] = NOISE, False
    return 0


cdef Py_ssize_t cut_at_gaps(const double[::1] samples, const Py_ssize_t[::1] order, const unsigned char[::1] chosen,
                            Py_ssize_t[::1] chain, double period, double eps) except -1 nogil:
    """Write the chain of each chosen sample; return their number."""
    cdef Py_ssize_t k, at, count = 0, first = -1, last = -1
    for k in range(samples.shape[0]):
        at = order[k]
        if not chosen[at]:
            continue
        if last < 0 or samples[at] - samples[last] > eps:
            count += 1
        if first < 0:
            first = at
        chain[at], last = count - 1, at
    if count > 1 and samples[first] + period - samples[last] <= eps:
        for at in range(samples.shape[0]):
            if chosen[at] and chain[at] == count - 1:
                chain[at] = 0
        count -= 1
    return count
