# SPDX-License-Identifier: Apache-2.0
"""Rotation hypotheses (section 2.2.1, Eq. 9), as `core.registration.rotation`."""


def pair_weights(reference, current, parameters):
    """Return the weight ``(n, m)`` of each pair: its shorter length [m], less where the directions are uncertain."""
    return weights_of(views_of_segments(reference), views_of_segments(current), parameters)


cdef weights_of(SegmentViews reference, SegmentViews current, parameters):
    """Return the `pair_weights` ``(n, m)``."""
    cdef double width = parameters.max_width, variance
    cdef Py_ssize_t i, j
    weights = np.empty((reference.size, current.size))
    cdef double[:, ::1] weight = weights
    for i in range(reference.size):
        for j in range(current.size):
            weight[i, j] = min(reference.length[i], current.length[j])
            if width:
                variance = reference.sigma[i] * reference.sigma[i] + current.sigma[j] * current.sigma[j]
                weight[i, j] /= 1.0 + variance / (width * width)
    return weights


def estimate_rotations(reference, current, weights, parameters):
    """Cluster all angle differences (Eq. 9) with DBSCAN; the heaviest clusters are the hypotheses.

    Core samples by more than one neighbour are the reference's.

    Parameters
    ----------
    reference, current : Segments
        n and m of them.
    weights : (n, m) array
        From `pair_weights`.
    parameters : RotationParameters
    """
    if parameters.min_samples > 1:
        return rotation_steps.estimate_rotations(reference, current, weights, parameters)
    cdef RotationClusters found = RotationClusters(views_of_segments(reference), views_of_segments(current),
                                                   np.ascontiguousarray(weights), parameters)
    return Rotations(np.asarray(found.phi), np.asarray(found.weight), np.asarray(found.difference),
                     np.asarray(found.labels).reshape(len(reference), len(current)), found.eps)


cdef class RotationClusters:
    """The `Rotations` of n x m pairs of segments; `labels` is flat."""

    cdef double[:, ::1] difference
    cdef Py_ssize_t[::1] labels
    cdef double[::1] phi, weight
    cdef double eps

    def __cinit__(self, SegmentViews reference, SegmentViews current, weights, parameters):
        cdef double period = 2.0 * M_PI
        cdef Py_ssize_t n = reference.size, m = current.size, size = n * m, i, j
        differences = np.empty((n, m))
        cdef double[::1] samples = differences.reshape(-1)
        cdef Py_ssize_t[:, ::1] work = np.zeros((3, size), np.intp)
        cdef Py_ssize_t[::1] order = work[0], found = work[1]
        for i in range(n):
            for j in range(m):
                samples[i * m + j] = wrapped(reference.direction[i] - current.direction[j], period)
        sort_stably(samples, order, work[2])
        self.difference, self.eps = differences, parameters.eps
        if self.eps == 0.0 and size:
            self.eps = min(max(nearest_knee(samples, order), <double> parameters.eps_min), <double> parameters.eps_max)
        cluster_angles(samples, order, found, period, self.eps, parameters.max_width)
        self.labels = work[2]
        self.rank(samples, weights.reshape(-1), found, period, parameters.max_hypotheses)

    cdef int rank(self, const double[::1] samples, const double[::1] sample_weight, const Py_ssize_t[::1] labels,
                  double period, Py_ssize_t most) except -1:
        """Write the weighted mean and the weight of the heaviest clusters, and the rank of each sample's cluster."""
        cdef Py_ssize_t size = samples.shape[0], k, at, clusters = 0, count = 0
        for k in range(size):
            clusters = max(clusters, labels[k] + 1)
        cdef double[:, ::1] total = np.zeros((5, clusters))
        cdef Py_ssize_t[:, ::1] work = np.zeros((4, clusters), np.intp)
        cdef Py_ssize_t[::1] used = work[0], order = work[1], rank = work[3]
        cdef double[::1] mean = total[3], weight = total[4]
        with nogil:
            for k in range(size):
                # Negative: the heaviest come first.
                total[0, labels[k]] -= sample_weight[k]
                total[2, labels[k]], used[labels[k]] = samples[k], 1
            for k in range(size):
                at = labels[k]
                total[1, at] += sample_weight[k] * wrapped(samples[k] - total[2, at], period)
            sort_up_to_rounding(total[0], order, work[2])
            for k in range(clusters):
                at, rank[order[k]] = order[k], -1
                # Numbers of clusters that were clustered again are unused.
                if used[at] and count < most:
                    weight[count], rank[at] = -total[0, at], count
                    mean[count] = wrap(total[2, at] + total[1, at] / weight[count])
                    count += 1
            for k in range(size):
                self.labels[k] = rank[labels[k]]
        self.phi, self.weight = mean[:count], weight[:count]
        return 0


cdef double nearest_knee(const double[::1] samples, const Py_ssize_t[::1] order) except? -1.0:
    """Return the knee of the sorted distances to the nearest neighbours: farthest below the chord of their ends."""
    cdef Py_ssize_t size = samples.shape[0], k
    cdef double before, after
    if size == 1:
        return 0.0
    nearest_distance = np.empty(size)
    cdef double[::1] graph = nearest_distance
    for k in range(size):
        before = samples[order[k]] - samples[order[k - 1]] if k else INFINITY
        after = samples[order[k + 1]] - samples[order[k]] if k + 1 < size else INFINITY
        graph[k] = min(before, after)
    nearest_distance.sort()
    # In ascending order here, in descending order in the reference.
    if size < 3 or graph[size - 1] <= graph[0]:
        return graph[0]
    cdef double slope = (graph[0] - graph[size - 1]) / <double> (size - 1)
    cdef double[::1] off = np.empty(size)
    for k in range(size):
        off[k] = graph[size - 1] + k * slope - graph[size - 1 - k]
    return graph[size - 1 - first_largest(off)]


cdef int cluster_angles(const double[::1] samples, const Py_ssize_t[::1] order, Py_ssize_t[::1] labels, double period,
                        double eps, double max_width) except -1:
    """Cut the sorted angles at the gaps, and clusters wider than `max_width` again with half the neighbourhood."""
    cdef Py_ssize_t size = samples.shape[0], level, k, at, count, chains, offset = 0, last, number
    cdef Py_ssize_t[:, ::1] work = np.empty((2, size), np.intp)
    cdef Py_ssize_t[::1] chain = work[0], rank = work[1]
    cdef unsigned char[::1] chosen = np.ones(size, np.uint8)
    cdef double[:, ::1] limits = np.empty((3, size))
    cdef double[::1] first = limits[0], low = limits[1], high = limits[2]
    cdef double value
    with nogil:
        for level in range(2):
            chains = cut_at_gaps(samples, order, chosen, chain, period, eps * 0.5 ** level)
            if not chains:
                break
            # Clusters are numbered by their first samples.
            for number in range(chains):
                rank[number], low[number], high[number] = -1, 0.0, 0.0
            count = 0
            for at in range(size):
                if chosen[at]:
                    if rank[chain[at]] < 0:
                        rank[chain[at]] = count
                        count += 1
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
