# SPDX-License-Identifier: Apache-2.0
"""Translation hypotheses (section 2.2.2, Eq. 10-15), as `core.registration.translation`."""


def estimate_translations(reference, current, rotations, weights, parameters):
    """Cluster the translations that follow from pairs of matched lines and from matched end points, for every rotation.

    Squared equations, core samples by more than one neighbour and scikit-learn are the reference's.

    Parameters
    ----------
    reference, current : Segments
        n and m of them.
    rotations : Rotations
    weights : (n, m) array
        Weight of each pair of segments.
    parameters : TranslationParameters
    """
    p = parameters
    if p.form != 'signed' or p.clustering != 'built_in' or p.min_samples > 1:
        return translation_steps.estimate_translations(reference, current, rotations, weights, p)
    pairs, offs = match_lines(rotations.difference, rotations.phi, np.ascontiguousarray(weights), p.parallel_sigma,
                              p.max_pairs)
    equations = signed_equations(reference, current, rotations.phi, pairs, offs)
    translation, weight, rotation = translation_samples(reference, current, rotations.phi, pairs, equations, p)
    find_shortest = partial(shortest_translations, pairs, equations, rotations.phi[:p.shortest_rotations])
    if not len(translation):
        return Translations(np.empty((0, 3)), np.empty(0), np.empty((0, 2)), weight, rotation, np.empty(0, int), 0.0,
                            find_shortest)
    labels = cluster_translations(translation, rotation, p.eps, p.max_width)
    transform, total, ranked = rank_translations(translation, weight, rotation, labels, rotations.phi)
    return Translations(transform, total, translation.view(float).reshape(-1, 2), weight, rotation, ranked, p.eps,
                        find_shortest)


cdef match_lines(const double[:, ::1] difference, const double[::1] phi, const double[:, ::1] weights, double sigma,
                 Py_ssize_t max_pairs):
    """Return the heaviest pairs of lines that each rotation makes parallel (Eq. 12), and the angles between them."""
    cdef Py_ssize_t m = difference.shape[1], size = difference.shape[0] * m, k, i, count, total = 0, kept
    cdef Py_ssize_t most = phi.shape[0] * min(max_pairs, size)
    indices, numbers = np.empty((3, most), np.intp), np.empty((2, most))
    cdef Py_ssize_t[:, ::1] index = indices
    cdef double[:, ::1] number = numbers
    cdef double[:, ::1] found = np.empty((2, size))
    cdef Py_ssize_t[:, ::1] work = np.empty((3, size), np.intp)
    cdef double[::1] heavy = found[0], off = found[1]
    cdef Py_ssize_t[::1] pair = work[0], order = work[1], scratch = work[2]
    cdef double angle
    with nogil:
        for k in range(phi.shape[0]):
            count = 0
            for i in range(size):
                angle = wrapped(difference[i // m, i % m] - phi[k], 2.0 * M_PI)
                if fabs(angle) < 2.0 * sigma:
                    # Negative: the heaviest come first.
                    heavy[count] = -exp(-0.5 * (angle / sigma) * (angle / sigma)) * weights[i // m, i % m]
                    off[count], pair[count] = angle, i
                    count += 1
            sort_stably(heavy[:count], order, scratch)
            for i in range(min(count, max_pairs)):
                index[0, total], index[1, total], index[2, total] = k, pair[order[i]] // m, pair[order[i]] % m
                number[0, total], number[1, total] = -heavy[order[i]], off[order[i]]
                total += 1
    kept = total
    return translation_steps.LinePairs(*[row[:kept] for row in indices], numbers[0, :kept]), numbers[1, :kept]


cdef signed_equations(reference, current, const double[::1] phi, pairs, const double[::1] off):
    """Return the equation ``n . t = n . (m_R - Rot(phi) m_O)`` of each pair of lines (Eq. 13)."""
    cdef const Py_ssize_t[::1] rotation = pairs.rotation, ours = pairs.reference, theirs = pairs.current
    cdef const double[:, :] start_r = reference.start, end_r = reference.end
    cdef const double[:, :] start_o = current.start, end_o = current.end
    cdef const double[:] direction = reference.direction
    cdef Py_ssize_t size = rotation.shape[0], k, i, j
    alongs, distances = np.empty(size, complex), np.empty(size)
    cdef double complex[::1] along = alongs
    cdef double[::1] distance = distances
    cdef double angle, c, s, x, y
    with nogil:
        for k in range(size):
            angle = direction[ours[k]] - 0.5 * off[k]
            along[k] = cos(angle) + 1j * sin(angle)
            c, s = cos(phi[rotation[k]]), sin(phi[rotation[k]])
            i, j = ours[k], theirs[k]
            x, y = 0.5 * (start_o[j, 0] + end_o[j, 0]), 0.5 * (start_o[j, 1] + end_o[j, 1])
            distance[k] = cross(along[k], 0.5 * (start_r[i, 0] + end_r[i, 0]) - (c * x - s * y)
                                + 1j * (0.5 * (start_r[i, 1] + end_r[i, 1]) - (s * x + c * y)))
    return translation_steps.LineEquations(alongs, distances)


cdef translation_samples(reference, current, const double[::1] phi, pairs, equations, p):
    """Return the translations of `add_line_samples` and of `add_end_samples`, their weights and rotations."""
    cdef const Py_ssize_t[::1] rotation = pairs.rotation
    cdef Py_ssize_t size = rotation.shape[0], most = 2 * size, run = 0, k, count
    for k in range(size):
        run = run + 1 if k and rotation[k] == rotation[k - 1] else 0
        most += run
    found, sums, groups = np.empty(most, complex), np.empty(most), np.empty(most, np.intp)
    count = add_line_samples(pairs, equations, p.min_crossing_sine, found, sums, groups)
    count = add_end_samples(reference, current, phi, pairs, p.end_weight, count, found, sums, groups)
    return found[:count], sums[:count], groups[:count]


cdef Py_ssize_t add_line_samples(pairs, equations, double min_crossing_sine, double complex[::1] translation,
                                 double[::1] sample_weight, Py_ssize_t[::1] group) except -1:
    """Solve all pairs of non-parallel line equations of each rotation (Eq. 14-15); return the number of samples."""
    cdef const Py_ssize_t[::1] rotation = pairs.rotation
    cdef const double[::1] weight = pairs.weight, distance = equations.distance
    cdef const double complex[::1] along = equations.along
    cdef Py_ssize_t size = rotation.shape[0], first, second, count = 0
    cdef double determinant
    with nogil:
        for first in range(size):
            for second in range(first + 1, size):
                if rotation[second] != rotation[first]:
                    break
                determinant = cross(along[first], along[second])
                if fabs(determinant) > min_crossing_sine:
                    translation[count] = (
                        distance[first] * along[second] - distance[second] * along[first]) / determinant
                    sample_weight[count] = min(weight[first], weight[second]) * fabs(determinant)
                    group[count] = rotation[first]
                    count += 1
    return count


cdef const double[:, ::1] END_WEIGHT = translation_steps._END_WEIGHT


cdef Py_ssize_t add_end_samples(reference, current, const double[::1] phi, pairs, double end_weight, Py_ssize_t count,
                                double complex[::1] translation, double[::1] sample_weight,
                                Py_ssize_t[::1] group) except -1:
    """Append translations that match start points with start points and end points with end points; count them all."""
    cdef const Py_ssize_t[::1] rotation = pairs.rotation, ours = pairs.reference, theirs = pairs.current
    cdef const double[::1] weight = pairs.weight
    cdef const Py_ssize_t[:, :] kind_r = reference.kinds, kind_o = current.kinds
    cdef const double[:, :] a, b
    cdef Py_ssize_t side, k
    cdef double c, s, x, y, share
    for side in range(2):
        a, b = (reference.end, current.end) if side else (reference.start, current.start)
        for k in range(rotation.shape[0]):
            share = end_weight * END_WEIGHT[kind_r[ours[k], side], kind_o[theirs[k], side]]
            if share == 0.0:
                continue
            c, s = cos(phi[rotation[k]]), sin(phi[rotation[k]])
            x = a[ours[k], 0] - (c * b[theirs[k], 0] - s * b[theirs[k], 1])
            y = a[ours[k], 1] - (s * b[theirs[k], 0] + c * b[theirs[k], 1])
            translation[count], sample_weight[count], group[count] = x + 1j * y, weight[k] * share, rotation[k]
            count += 1
    return count


def shortest_translations(pairs, equations, const double[::1] phi):
    """Find the shortest translation that aligns all lines, for each of the first rotations `phi` ``(K,)``.

    Robust and damped least squares: between parallel walls, where no two lines cross, the component along them is 0.

    Returns
    -------
    (K, 3) array
    """
    cdef const Py_ssize_t[::1] rotation = pairs.rotation
    cdef const double[::1] weight = pairs.weight, distance = equations.distance
    cdef const double complex[::1] along = equations.along
    cdef double scale, damping = translation_steps._SHORTEST_DAMPING, e
    cdef Py_ssize_t h, k
    cdef double[3] step
    cdef Equations sums
    motions = np.zeros((phi.shape[0], 3))
    cdef double[:, ::1] found = motions
    for scale in translation_steps._SHORTEST_SCALES:
        for h in range(phi.shape[0]):
            sums = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            for k in range(rotation.shape[0]):
                if rotation[k] == h:
                    # n . t - d for the normal n = i a of a line along a.
                    e = -along[k].imag * found[h, 0] + along[k].real * found[h, 1] - distance[k]
                    add_row(&sums, weight[k] / (1.0 + (e / scale) * (e / scale)), -along[k].imag, along[k].real, 0.0,
                            -distance[k])
            solve_step(&sums, damping, step)
            found[h, 0], found[h, 1] = -step[0], -step[1]
    motions[:, 2] = phi
    return motions
