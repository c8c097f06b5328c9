# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Scan-to-map alignment: registers a scan to all key frames at once, and estimates covariance and observability."""
from dataclasses import replace

import numpy as np

from ..features.oriented_points import high_leverage
from ..geometry import tolerance
from ..geometry.se2 import SE2
from .correspondences import Correspondences, PosePrior
from .lookup import look_up_pairs, points_by_frame
from .observability import strengthened

from libc.math cimport cos, exp, fabs, sin

from ..geometry.plane cimport length_of, wrap
from ..geometry.symmetric cimport Weakest, read_weakest
from ..registration.point_to_line cimport Equations, add_row, product_imag, solve_step, write_equations
from ..registration.uncertainty cimport covariance_of, is_corridor_like, turned, write_parallel
from ..registration.views cimport PointViews, views_of

cdef double TINY = tolerance.TINY
# A direction is well constrained if its information is at least this fraction of the information across it.
cdef double WELL_CONSTRAINED = 0.02
# If the points move by more than this ratio of the cell size on average, correspondences are looked up again.
cdef double MAX_DISPLACEMENT = 0.25
# The size of a subset of points is about `density.max_points` divided by this number.
cdef Py_ssize_t SUBSETS = 3


def align_to_map(window, features, initial, prior, p, coarse=None):
    """Align a scan with all key frames of the window.

    Parameters
    ----------
    window : KeyFrameWindow
    features : Features
        Of the scan.
    initial : InitialAlignment
        Where the rotation is unobservable, it is left to the prior: the alignment starts at the prior's pose.
    prior : PosePrior
        Information in the frame of the scan [1/m^2, 1/rad^2]; zero where it contradicts `initial`.
    p : Parameters
    coarse : KeyFrameWindow, optional
        Key frames with which all iterations but the last align the scan; None: those of `window`. In the last
        iteration the others have the weights of `weighted_by_agreement`.

    Returns
    -------
    pose : SE2
        Pose of the scan in the odometry frame.
    correspondences : Correspondences
    """
    coarse = window if coarse is None else coarse
    points, direction = features.oriented_points, initial.direction
    scales, damping = p.refinement.window_scales(features.noise), p.refinement.damping
    last = max(len(scales) - 1, 0)
    noise = max(p.refinement.map_scale, features.noise)
    information = noise ** 2 * turned(prior.information, prior.pose.theta)
    pose = prior.pose if initial.rotation_unobservable else initial.pose
    found = find_correspondences(coarse, pose, points, direction, p)
    if direction is not None or initial.rotation_unobservable:
        information = strengthened(information, features, found, initial, p)
    prior = PosePrior(prior.pose, information)
    pose = align(found, pose, prior, scales[:last], damping)
    # The nearest lines of dense points change with small steps, those of sparse points hardly.
    cell = p.density.cell_size
    if (coarse is not window or len(points) > p.density.max_points
            or displacement(found, pose) > MAX_DISPLACEMENT * cell):
        own, found = found, find_correspondences(window, pose, points, direction, p)
        if coarse is not window:
            found = weighted_by_agreement(found, own, window.is_in(coarse), p.refinement.map_first_scale, noise)
    return align(found, pose, prior, scales[last:], damping), found


cdef find_correspondences(window, pose, points, direction, p):
    """Look up correspondences; near-parallel walls count as parallel to the degenerate `direction` [rad], if any.

    Without one, the direction that is constrained least is used, if it is weakly constrained.
    """
    found = look_up_correspondences(window, pose, points, p.density)
    cdef double[:, ::1] rows = found.rows, information = np.empty((4, 4))
    cdef double[::1] error = np.empty(rows.shape[1]), weight = np.empty(rows.shape[1])
    cdef double[4] step = [0.0, 0.0, 0.0, 1.0]
    cdef double across, least, angle
    cdef double[3] motion
    cdef Equations sums = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cdef Weakest weakest
    cdef Py_ssize_t k
    weigh(rows, found.index, found.size, found.weights, step, p.refinement.map_first_scale, error, weight)
    for k in range(rows.shape[1]):
        add_row(&sums, weight[k], rows[0, k], rows[1, k], rows[2, k], rows[3, k])
    write_equations(&sums, &information[0, 0])
    if direction is None:
        read_weakest(information, &weakest)
        if weakest.weak >= WELL_CONSTRAINED * weakest.strong:
            return found
        direction = weakest.angle
    angle = direction
    if not is_corridor_like(information, angle):
        return found
    least = p.degeneracy.parallel_tolerance
    write_parallel(angle, information, p.decision.min_information, motion)
    for k in range(rows.shape[1]):
        across = motion[0] * rows[0, k] + motion[1] * rows[1, k] + motion[2] * rows[2, k]
        if fabs(across) < least * length_of(rows[0, k], rows[1, k]):
            rows[0, k], rows[1, k] = rows[0, k] - motion[0] * across, rows[1, k] - motion[1] * across
    return found


def look_up_correspondences(window, pose, points, density):
    """Look up the lines of all key frames that the `points` of a scan at `pose` (odometry frame) lie on.

    Points of high leverage are looked up in every key frame. The others, where a scan has many, are split into
    subsets; each subset is looked up in several key frames, and each key frame looks up one.
    """
    lookup = points_by_frame(high_leverage(points.normals), points.beams, len(window.frames),
                             density.max_points // SUBSETS)
    frame, index, turned_points, lines, error = look_up_pairs(window.fields, window.poses, pose, points, lookup,
                                                              density.min_normal_cosine)
    cdef const double complex[::1] rotated_point = turned_points, normal = lines
    cdef const double[::1] off = error
    cdef Py_ssize_t k
    table = np.empty((4, len(index)))
    cdef double[:, ::1] rows = table
    with nogil:
        for k in range(normal.shape[0]):
            rows[0, k], rows[1, k] = normal[k].real, -normal[k].imag
            rows[2, k], rows[3, k] = -product_imag(normal[k], rotated_point[k]), off[k]
    weights = None if points.weights is None else points.weights.take(index)
    return Correspondences(pose, len(points), frame, index, turned_points, table, weights)


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


cdef double displacement(found, other) except? -1.0:
    """Return the mean distance [m] by which the points move from the pose of the correspondences to another pose."""
    cdef const double complex[::1] points = found.rotated_points
    pose = found.pose
    cdef double dx = other.x - pose.x, dy = other.y - pose.y, t = wrap(other.theta - pose.theta)
    cdef double c = cos(t) - 1.0, s = sin(t), total = 0.0
    cdef Py_ssize_t k
    for k in range(points.shape[0]):
        total += length_of(dx + c * points[k].real - s * points[k].imag, dy + s * points[k].real + c * points[k].imag)
    return total / max(points.shape[0], 1)


def alignment_uncertainty(features, pose, correspondences, initial, p):
    """Estimate covariance and observability of a scan aligned at `pose`.

    Returns
    -------
    covariance : (3, 3) float
        In the frame of the scan [m, m, rad].
    observability : Observability
        Directions in the odometry frame.
    """
    rows, start = correspondences.rows, correspondences.pose
    cdef PointViews views = views_of(features.oriented_points)
    cdef const double complex[::1] rotated_point = correspondences.rotated_points
    cdef const Py_ssize_t[::1] index = correspondences.index
    cdef Py_ssize_t size = index.shape[0], k
    cdef double[::1] error = np.empty(size), weight = np.empty(size)
    cdef double[:, ::1] own = np.empty((3, size))
    cdef double[4] step = [pose.x - start.x, pose.y - start.y, wrap(pose.theta - start.theta), 1.0]
    cdef double theta = pose.theta, c = cos(theta), s = sin(theta), x, y
    weigh(rows, index, correspondences.size, correspondences.weights, step, p.refinement.score_scale, error, weight)
    with nogil:
        for k in range(size):
            x = views.normals[index[k]].real * views.inverse_noise[index[k]]
            y = views.normals[index[k]].imag * views.inverse_noise[index[k]]
            own[0, k], own[1, k] = c * x - s * y, s * x + c * y
            own[2, k] = rotated_point[k].real * own[1, k] - rotated_point[k].imag * own[0, k]
    return covariance_of(error, weight, rows[:3], own, features.noise, p.decision, theta,
                         initial.direction is not None, initial.rotation_unobservable)
