# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Translation hypotheses (section 2.2.2, Eq. 10-15)."""
import numpy as np

from ...features.records import EndKind
from ...parameters.registration import MIN_CROSSING_SINE
from ..hypotheses import Translations

from libc.math cimport M_PI, cos, fabs, sin

from ...geometry.exponential cimport decaying_exp
from ...geometry.ordering cimport sort_up_to_rounding
from ...geometry.plane cimport cross, rotated, wrap, wrapped
from ..point_to_line cimport Equations, add_row, solve_step
from ..scoring cimport are_near
from ..views cimport SegmentViews, views_of_segments
from .clusters cimport NOISE, cluster_translations
from .rotation cimport RotationClusters, cluster_rotations, weights_of

# Standard deviation [rad] of the angle between two lines that are matched as parallel (eps1 of Eq. 12): that of a short
# wall with noise of a few centimetres.
cdef double PARALLEL_SIGMA = 0.06
# Number of line pairs that are used for each rotation, the heaviest first: the walls of a room, each seen in pieces.
MAX_PAIRS = 14


def estimate_translations(reference, current, rotations, weights, parameters):
    """Return the `Translations` that `cluster_lines` finds, as arrays.

    Parameters
    ----------
    reference, current : Segments
        n and m of them.
    rotations : Rotations
    weights : (n, m) array [m]
        From `pair_weights`.
    parameters : TranslationParameters
    """
    cdef TranslationClusters found = cluster_lines(views_of_segments(reference), views_of_segments(current),
                                                   np.ravel(rotations.difference), rotations.phi, np.ravel(weights),
                                                   parameters)
    samples = np.asarray(found.samples).view(float).reshape(-1, 2)
    return Translations(np.asarray(found.motion), np.asarray(found.weight), samples, np.asarray(found.sample_weight),
                        np.asarray(found.rotation), np.asarray(found.labels), parameters.eps if len(samples) else 0.0)


def heaviest_motions(problem):
    """Return the heaviest clusters ``(C, 3)`` and the `shortest_translations` ``(K, 3)`` [m, m, rad] of a `Problem`."""
    p = problem.parameters
    cdef SegmentViews ours = views_of_segments(problem.reference.segments)
    cdef SegmentViews theirs = views_of_segments(problem.current.segments)
    cdef double[::1] weights = weights_of(ours, theirs, p.rotation)
    cdef RotationClusters rotations = cluster_rotations(ours, theirs, weights, p.rotation)
    cdef TranslationClusters found = cluster_lines(ours, theirs, rotations.difference, rotations.phi, weights,
                                                   p.translation)
    cdef Py_ssize_t count = min(rotations.phi.shape[0], <Py_ssize_t> p.translation.shortest_rotations)
    return (np.asarray(found.motion[:min(found.motion.shape[0], <Py_ssize_t> p.selection.max_clusters)]),
            shortest_translations(found.lines, rotations.phi[:count]))


def near_motions(problem, prior):
    """Return the clusters ``(C, 3)`` [m, m, rad] of a `Problem` within the gate around a `Prior`, heaviest first."""
    p = problem.parameters
    cdef SegmentViews ours = views_of_segments(problem.reference.segments)
    cdef SegmentViews theirs = views_of_segments(problem.current.segments)
    cdef double[::1] weights = weights_of(ours, theirs, p.rotation)
    cdef RotationClusters rotations = cluster_rotations(ours, theirs, weights, p.rotation)
    cdef double[:, ::1] motion
    expected = prior.transform
    cdef double gate = p.prior.gate, angle = gate * <double> prior.rotation_sigma, reach
    cdef double x = expected.x, y = expected.y, theta = expected.theta
    cdef Py_ssize_t most = p.selection.max_clusters, count = 0, h, k
    for h in range(rotations.phi.shape[0]):
        if fabs(wrap(rotations.phi[h] - theta)) <= angle:
            rotations.phi[count] = rotations.phi[h]
            count += 1
    motion = cluster_lines(ours, theirs, rotations.difference, rotations.phi[:count], weights, p.translation).motion
    reach, count = gate * <double> prior.translation_sigma, 0
    for h in range(motion.shape[0]):
        if count < most and are_near(motion[h, 0] - x, motion[h, 1] - y, motion[h, 2] - theta, reach, angle):
            for k in range(3):
                motion[count, k] = motion[h, k]
            count += 1
    return np.asarray(motion[:count])


cdef class MatchedLines:
    """The L heaviest pairs of lines that each rotation makes parallel (Eq. 12), and their equations (Eq. 14).

    The equation of a pair is ``n . t = n . (m_R - Rot(phi) m_O)``.
    """

    cdef Py_ssize_t[::1] rotation, ours, theirs
    # Weight of each pair, angle between the lines [rad], distance of the line of translations from 0 [m].
    cdef double[::1] weight, off, distance
    cdef double complex[::1] along
    cdef Py_ssize_t size


cdef MatchedLines match_lines(SegmentViews reference, SegmentViews current, const double[::1] difference,
                              const double[::1] phi, const double[::1] weights, Py_ssize_t max_pairs):
    """Return the heaviest pairs of each rotation, and their equations."""
    cdef Py_ssize_t m = current.size, size = difference.shape[0], most = phi.shape[0] * min(max_pairs, size)
    cdef Py_ssize_t k, i, count
    cdef MatchedLines lines = MatchedLines.__new__(MatchedLines)
    cdef Py_ssize_t[:, ::1] index = np.empty((3, max(most, size)), np.intp), work = np.empty((3, size), np.intp)
    cdef double[:, ::1] number = np.empty((5, max(most, size)))
    cdef double[::1] heavy = number[3], off = number[4]
    cdef Py_ssize_t[::1] pair = work[0], order = work[1], scratch = work[2]
    cdef double angle
    lines.rotation, lines.ours, lines.theirs = index[0], index[1], index[2]
    lines.weight, lines.off, lines.distance = number[0], number[1], number[2]
    lines.along = np.empty(most, complex)
    with nogil:
        for k in range(phi.shape[0]):
            count = 0
            for i in range(size):
                angle = wrapped(difference[i] - phi[k], 2.0 * M_PI)
                if fabs(angle) < 2.0 * PARALLEL_SIGMA:
                    # Negative: the heaviest come first.
                    heavy[count] = -decaying_exp(-0.5 * (angle / PARALLEL_SIGMA) * (angle / PARALLEL_SIGMA)) * weights[i]
                    off[count], pair[count] = angle, i
                    count += 1
            sort_up_to_rounding(heavy[:count], order, scratch)
            for i in range(min(count, max_pairs)):
                lines.rotation[lines.size] = k
                lines.ours[lines.size], lines.theirs[lines.size] = pair[order[i]] // m, pair[order[i]] % m
                lines.weight[lines.size], lines.off[lines.size] = -heavy[order[i]], off[order[i]]
                lines.size += 1
        write_lines(lines, reference, current, phi)
    return lines


cdef int write_lines(MatchedLines lines, SegmentViews reference, SegmentViews current,
                     const double[::1] phi) except -1 nogil:
    """Write the direction and the distance (Eq. 14) of the line of translations of each pair, after Eq. 10."""
    cdef Py_ssize_t k, i, j
    cdef double complex turn
    cdef double angle
    for k in range(lines.size):
        i, j = lines.ours[k], lines.theirs[k]
        angle = reference.direction[i] - 0.5 * lines.off[k]
        lines.along[k] = cos(angle) + 1j * sin(angle)
        turn = cos(phi[lines.rotation[k]]) + 1j * sin(phi[lines.rotation[k]])
        lines.distance[k] = cross(lines.along[k], reference.middle[i] - rotated(turn, current.middle[j]))
    return 0


cdef class TranslationClusters:
    """The `Translations` that follow from rotations, as views."""

    cdef MatchedLines lines
    cdef double complex[::1] samples
    cdef double[::1] sample_weight, weight
    cdef Py_ssize_t[::1] rotation, labels
    cdef double[:, ::1] motion


cdef TranslationClusters cluster_lines(SegmentViews reference, SegmentViews current, const double[::1] difference,
                                       const double[::1] phi, const double[::1] weights, parameters):
    """Cluster the translations [m] that follow from matched lines and matched end points, for every rotation [rad]."""
    cdef TranslationClusters found = TranslationClusters.__new__(TranslationClusters)
    cdef MatchedLines lines = match_lines(reference, current, difference, phi, weights, MAX_PAIRS)
    cdef Py_ssize_t most = 2 * lines.size, run = 0, k, count
    for k in range(lines.size):
        run = run + 1 if k and lines.rotation[k] == lines.rotation[k - 1] else 0
        most += run
    cdef double[::1] weight = np.empty(most)
    cdef double complex[::1] translation = np.empty(most, complex)
    cdef Py_ssize_t[::1] group = np.empty(most, np.intp)
    count = add_line_samples(lines, MIN_CROSSING_SINE, translation, weight, group)
    count = add_end_samples(reference, current, phi, lines, parameters.end_weight, count, translation, weight, group)
    found.lines = lines
    found.samples, found.sample_weight, found.rotation = translation[:count], weight[:count], group[:count]
    found.labels = cluster_translations(found.samples, found.rotation, parameters.eps, parameters.min_samples)
    rank_translations(found, phi)
    return found


cdef int rank_translations(TranslationClusters found, const double[::1] phi) except -1:
    """Write weighted mean and weight of each cluster, heaviest first, and the rank of each sample's cluster."""
    cdef const double complex[::1] samples = found.samples
    cdef const double[::1] sample_weight = found.sample_weight
    cdef Py_ssize_t[::1] labels = found.labels
    cdef Py_ssize_t size = samples.shape[0], clusters = 0, k, at
    for k in range(size):
        clusters = max(clusters, labels[k] + 1)
    cdef double[:, ::1] total = np.zeros((5, clusters)), motion = np.empty((clusters, 3))
    cdef double[::1] weight = total[4]
    cdef Py_ssize_t[:, ::1] work = np.empty((3, clusters), np.intp)
    cdef Py_ssize_t[::1] order = work[0], rank = work[1]
    with nogil:
        for k in range(size):
            at = labels[k]
            if at == NOISE:
                continue
            # Negative: the heaviest come first.
            total[0, at] -= sample_weight[k]
            total[1, at] += sample_weight[k] * samples[k].real
            total[2, at] += sample_weight[k] * samples[k].imag
            total[3, at] = phi[found.rotation[k]]
        sort_up_to_rounding(total[0], order, work[2])
        for k in range(clusters):
            at = order[k]
            weight[k], rank[at] = -total[0, at], k
            motion[k, 0], motion[k, 1] = total[1, at] / weight[k], total[2, at] / weight[k]
            motion[k, 2] = total[3, at]
        for k in range(size):
            labels[k] = NOISE if labels[k] == NOISE else rank[labels[k]]
    found.motion, found.weight = motion, weight
    return 0


cdef Py_ssize_t add_line_samples(MatchedLines lines, double min_crossing_sine, double complex[::1] translation,
                                 double[::1] sample_weight, Py_ssize_t[::1] group) except -1 nogil:
    """Solve the line equations of each rotation in pairs (Eq. 15) that cross (Eq. 13); return the number of samples."""
    cdef Py_ssize_t first, second, count = 0
    cdef double determinant
    for first in range(lines.size):
        for second in range(first + 1, lines.size):
            if lines.rotation[second] != lines.rotation[first]:
                break
            determinant = cross(lines.along[first], lines.along[second])
            if fabs(determinant) > min_crossing_sine:
                translation[count] = (lines.distance[first] * lines.along[second]
                                      - lines.distance[second] * lines.along[first]) / determinant
                sample_weight[count] = min(lines.weight[first], lines.weight[second]) * fabs(determinant)
                group[count] = lines.rotation[first]
                count += 1
    return count


cdef double[3][3] END_WEIGHT = [[0.1, 0.1, 0.1], [0.1, 0.1, 0.1], [0.1, 0.1, 0.1]]
END_WEIGHT[EndKind.CORNER][EndKind.CORNER] = 1.0
END_WEIGHT[EndKind.FREE][EndKind.FREE] = 0.7
END_WEIGHT[EndKind.CORNER][EndKind.FREE] = END_WEIGHT[EndKind.FREE][EndKind.CORNER] = 0.4
# Scale of the robust weight [m] in each iteration for the shortest translation, and the damping of its least squares.
cdef double[2] SHORTEST_SCALES = [1.0, 0.1]
cdef double SHORTEST_DAMPING = 0.01


cdef Py_ssize_t add_end_samples(SegmentViews reference, SegmentViews current, const double[::1] phi,
                                MatchedLines lines, double end_weight, Py_ssize_t count,
                                double complex[::1] translation, double[::1] sample_weight,
                                Py_ssize_t[::1] group) except -1 nogil:
    """Append translations that match rotated (Eq. 10) start points, and end points; return the number of samples."""
    cdef Py_ssize_t side, k, i, j
    cdef double c, s, x, y, share
    for side in range(2):
        for k in range(lines.size):
            i, j = lines.ours[k], lines.theirs[k]
            share = end_weight * END_WEIGHT[reference.kinds[i, side]][current.kinds[j, side]]
            if share == 0.0:
                continue
            c, s = cos(phi[lines.rotation[k]]), sin(phi[lines.rotation[k]])
            if side:
                x = reference.end[i, 0] - (c * current.end[j, 0] - s * current.end[j, 1])
                y = reference.end[i, 1] - (s * current.end[j, 0] + c * current.end[j, 1])
            else:
                x = reference.start[i, 0] - (c * current.start[j, 0] - s * current.start[j, 1])
                y = reference.start[i, 1] - (s * current.start[j, 0] + c * current.start[j, 1])
            translation[count], sample_weight[count] = x + 1j * y, lines.weight[k] * share
            group[count] = lines.rotation[k]
            count += 1
    return count


def shortest_translations(MatchedLines lines, const double[::1] phi):
    """Find the shortest translation that aligns all lines, for each of the first rotations `phi` ``(K,)`` [rad].

    Robust and damped least squares: between parallel walls, where no two lines cross, the component along them is 0.

    Returns
    -------
    (K, 3) array [m, m, rad]
    """
    cdef double scale, damping = SHORTEST_DAMPING, e, nx, ny
    cdef Py_ssize_t h, k
    cdef double[3] step
    cdef Equations sums
    motions = np.zeros((phi.shape[0], 3))
    cdef double[:, ::1] found = motions
    for scale in SHORTEST_SCALES:
        for h in range(phi.shape[0]):
            sums = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
            for k in range(lines.size):
                if lines.rotation[k] == h:
                    # n . t - d for the normal n = i a of a line along a.
                    nx, ny = -lines.along[k].imag, lines.along[k].real
                    e = nx * found[h, 0] + ny * found[h, 1] - lines.distance[k]
                    add_row(&sums, lines.weight[k] / (1.0 + (e / scale) * (e / scale)), nx, ny, 0.0,
                            -lines.distance[k])
            solve_step(&sums, damping, step)
            found[h, 0], found[h, 1] = -step[0], -step[1]
    motions[:, 2] = phi
    return motions
