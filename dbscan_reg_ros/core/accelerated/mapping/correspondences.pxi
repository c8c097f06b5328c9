# SPDX-License-Identifier: Apache-2.0
"""Robust alignment of a scan with all key frames."""


cdef int weigh(const double[:, ::1] rows, const Py_ssize_t[::1] index, Py_ssize_t points, given, double *step,
               double scale, double[::1] error, double[::1] weight) except -1:
    """Write the errors and weights of the pairs after a step; `given` weights multiply them."""
    cdef double[::1] total = np.zeros(points)
    cdef const double[::1] own = weight if given is None else given
    cdef bint weighted = given is not None
    cdef Py_ssize_t k
    cdef double factor = -0.5 / (scale * scale)
    with nogil:
        for k in range(rows.shape[1]):
            error[k] = step[0] * rows[0, k] + step[1] * rows[1, k] + step[2] * rows[2, k] + step[3] * rows[3, k]
            weight[k] = exp(factor * error[k] * error[k])
            total[index[k]] += weight[k]
        for k in range(rows.shape[1]):
            weight[k] /= max(total[index[k]], 1.0)
            if weighted:
                weight[k] *= own[k]
    return 0


def weighted_by_agreement(correspondences, own, const unsigned char[::1] is_own, double scale, double noise):
    """Weight the pairs with key frames of other lidars by their agreement with the key frames of the own lidar.

    Parameters
    ----------
    correspondences : Correspondences
        Of the scan with the key frames of all lidars.
    own : Correspondences
        Of the scan with those of its own lidar, at a pose nearby.
    is_own : (K,) bool
        Which key frames are those of the own lidar.
    scale : float [m]
        Of the kernel in the mean errors.
    noise : float [m]
        Standard deviation of an error.
    """
    cdef const double[:, ::1] rows = correspondences.rows, own_rows = own.rows
    cdef const double[::1] step = own.step(correspondences.pose)
    cdef const Py_ssize_t[::1] index = correspondences.index, frame = correspondences.frame, own_index = own.index
    cdef Py_ssize_t k, p
    cdef double factor = -0.5 / (scale * scale), e, w, apart
    # Of the pairs of each point with other and with own key frames: sum of the weights, and of the weighted errors.
    cdef double[:, ::1] sums = np.zeros((4, correspondences.size))
    weights = np.ones(rows.shape[1]) if correspondences.weights is None else correspondences.weights.copy()
    cdef double[::1] weight = weights, agreement = np.empty(correspondences.size)
    with nogil:
        for k in range(rows.shape[1]):
            if not is_own[frame[k]]:
                e, p = rows[3, k], index[k]
                w = exp(factor * e * e)
                sums[0, p] += w
                sums[1, p] += w * e
        for k in range(own_rows.shape[1]):
            e = step[0] * own_rows[0, k] + step[1] * own_rows[1, k] + step[2] * own_rows[2, k] + own_rows[3, k]
            p, w = own_index[k], exp(factor * e * e)
            sums[2, p] += w
            sums[3, p] += w * e
        for p in range(agreement.shape[0]):
            sums[0, p], sums[2, p] = max(sums[0, p], TINY), max(sums[2, p], TINY)
            apart = (sums[1, p] / sums[0, p] - sums[3, p] / sums[2, p]) / noise
            agreement[p] = exp(-0.5 * apart * apart / (1.0 / sums[0, p] + 1.0 / sums[2, p]))
        for k in range(rows.shape[1]):
            if not is_own[frame[k]]:
                weight[k] *= agreement[index[k]]
    return replace(correspondences, weights=weights)


def align(correspondences, start, prior, scales, double damping):
    """Align a scan with all key frames by robust point-to-line iterations, one for each of the `scales` [m].

    Parameters
    ----------
    correspondences : Correspondences
        Of the scan at a pose nearby.
    start : SE2
        Initial pose in the odometry frame.
    prior : PosePrior
        Information in the odometry frame, in units of one point's.
    scales : sequence of float [m]
        Scales of the kernel.
    damping : float
        As for `symmetric_matrix.solve`.
    """
    pose = correspondences.pose
    cdef const double[:, ::1] rows = correspondences.rows, known = prior.information
    cdef const Py_ssize_t[::1] index = correspondences.index
    cdef double[::1] error = np.empty(rows.shape[1]), weight = np.empty(rows.shape[1])
    cdef double[4] step = [start.x - pose.x, start.y - pose.y, wrap(start.theta - pose.theta), 1.0]
    cdef double x = pose.x - prior.pose.x, y = pose.y - prior.pose.y, t = wrap(pose.theta - prior.pose.theta)
    cdef Py_ssize_t k
    cdef double[3] found
    cdef Equations sums
    for scale in scales:
        weigh(rows, index, correspondences.size, correspondences.weights, step, scale, error, weight)
        sums = Equations(known[0, 0], known[0, 1], known[0, 2], known[0, 0] * x + known[0, 1] * y + known[0, 2] * t,
                         known[1, 1], known[1, 2], known[1, 0] * x + known[1, 1] * y + known[1, 2] * t,
                         known[2, 2], known[2, 0] * x + known[2, 1] * y + known[2, 2] * t, 0.0)
        for k in range(rows.shape[1]):
            add_row(&sums, weight[k], rows[0, k], rows[1, k], rows[2, k], rows[3, k])
        solve_step(&sums, damping, found)
        step[0], step[1], step[2] = -found[0], -found[1], -found[2]
    return SE2(pose.x + step[0], pose.y + step[1], wrap(pose.theta + step[2]))
