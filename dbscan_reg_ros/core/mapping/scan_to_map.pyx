# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Scan-to-map alignment: registers a scan to all key frames at once, and estimates covariance and observability."""
import numpy as np

from ..features.oriented_points import sample
from ..geometry import tolerance
from ..geometry.se2 import turned
from ..parameters.registration import MIN_CROSSING_SINE, SCORE_SCALE
from ..registration.uncertainty import degenerate_rotation, degenerate_translation, match_covariance, shared_information
from .correspondences import align, weighted_by_agreement
from .records import PosePrior

cimport cython
from libc.math cimport cos, fabs, sin

from ..features.oriented_points cimport OrientedPoints
from ..geometry.plane cimport length_of, wrap
from ..geometry.symmetric cimport Symmetric, Weakest, weakest_of
from ..registration.point_to_line cimport Equations, write_equations
from ..registration.uncertainty cimport is_corridor_like, make_walls_parallel, wall_direction, write_parallel
from .correspondences cimport Correspondences, Turned
from .lookup cimport ScanLookup

cdef double TINY = tolerance.TINY
# A direction is well constrained if its information is at least this fraction of the information across it.
cdef double WELL_CONSTRAINED = 0.02
# If the points move by more than this ratio of the cell size on average, correspondences are looked up again.
cdef double MAX_DISPLACEMENT = 0.25
# Ratio of the largest number of points in the first iterations to `density.max_points`.
cdef Py_ssize_t SAMPLED = 2
# At least this fraction of the points' information is assumed to be shared by both scans.
cdef double MIN_SHARED_RATIO = 1e-3


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
        Key frames with which all iterations but the last align the scan; in this, the others have the weights of
        `weighted_by_agreement`. None: those of `window`; unless a motion is degenerate, all iterations but two then
        take a `sample` of dense points.

    Returns
    -------
    pose : SE2
        Pose of the scan in the odometry frame.
    correspondences : Correspondences
    """
    coarse = window if coarse is None else coarse
    cdef double[3] motion
    cdef Correspondences found
    cdef OrientedPoints points = features.oriented_points, few = points
    direction, least = initial.direction, p.degeneracy.parallel_tolerance
    if coarse is window and direction is None and not initial.rotation_unobservable:
        few = sample(points, SAMPLED * p.density.max_points)
    scales, damping = p.refinement.window_scales(features.noise), p.refinement.damping
    last = max(len(scales) - (1 if few is points else 2), 0)
    noise = max(p.refinement.map_scale, features.noise)
    information = noise ** 2 * turned(prior.information, prior.pose.theta)
    pose = prior.pose if initial.rotation_unobservable else initial.pose
    found = ScanLookup(coarse.slots, few, p.density).at(pose)
    cdef bint parallel = find_parallel(found, direction, p, motion)
    if parallel:
        make_parallel(found, motion, least)
    if direction is not None or initial.rotation_unobservable:
        information = strengthened(information, features, found, initial, p)
    prior = PosePrior(prior.pose, information)
    pose = align(found, pose, prior, scales[:last], damping)
    # The nearest lines of dense points change with small steps, those of sparse points hardly.
    if (coarse is not window or points.size > p.density.max_points
            or displacement(found, pose) > MAX_DISPLACEMENT * p.density.cell_size):
        own, found = found, ScanLookup(window.slots, points, p.density).at(pose)
        if parallel:
            make_parallel(found, motion, least)
        if coarse is not window:
            weighted_by_agreement(found, own, window.is_in(coarse), p.refinement.map_first_scale, noise)
    return align(found, pose, prior, scales[last:], damping), found


cdef bint find_parallel(Correspondences found, direction, p, double *motion) except -1:
    """Find the motion that near-parallel walls count as parallel to, if any: along the degenerate `direction` [rad].

    Without one, the direction that is constrained least is used, if it is weakly constrained.
    """
    cdef double[3] step = [0.0, 0.0, 0.0]
    cdef Symmetric information
    cdef Equations sums = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cdef Weakest weakest
    found.add(step, p.refinement.map_first_scale, &sums)
    information = Symmetric(sums.xx, sums.xy, sums.xt, sums.yy, sums.yt, sums.tt)
    if direction is None:
        weakest = weakest_of(&information)
        if weakest.weak >= WELL_CONSTRAINED * weakest.strong:
            return False
        direction = weakest.angle
    if not is_corridor_like(&information, direction):
        return False
    write_parallel(direction, &information, p.decision.min_information, motion)
    return True


cdef void make_parallel(Correspondences found, const double *motion, double least) noexcept nogil:
    """Make the walls parallel that a `motion` moves across themselves by less than `least` [m]."""
    cdef double across
    cdef Py_ssize_t k
    for k in range(found.count):
        across = motion[0] * found.a[k] + motion[1] * found.b[k] + motion[2] * found.r[k]
        if fabs(across) < least * length_of(found.a[k], found.b[k]):
            found.a[k], found.b[k] = found.a[k] - motion[0] * across, found.b[k] - motion[1] * across


cdef strengthened(const double[:, ::1] information, features, Correspondences found, initial, p):
    """Strengthen the prior's `information` ``(3, 3)`` along degenerate motions.

    The points seem to constrain a degenerate motion, but mostly due to noise of their normals. To compensate, the
    prior's information is multiplied by the ratio of all information of the points to the part that both scans share.
    """
    cdef double[:, ::1] seeming = np.empty((4, 4)), shared, table, result = np.array(information)
    cdef double[3] step = [0.0, 0.0, 0.0]
    cdef Equations sums = Equations(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    found.add(step, p.refinement.map_first_scale, &sums)
    write_equations(&sums, &seeming[0, 0])
    table = residuals(found, features.oriented_points, step, found.pose.theta, features.scattered)
    shared = shared_information(table)
    if initial.direction is not None:
        strengthen(information, seeming, shared, degenerate_translation(initial.direction, shared, p.decision), result)
    if initial.rotation_unobservable:
        strengthen(information, seeming, shared, degenerate_rotation(seeming, shared, p.decision), result)
    return np.asarray(result)


cdef int strengthen(const double[:, ::1] information, const double[:, ::1] seeming, const double[:, ::1] shared,
                    const double[::1] motion, double[:, ::1] result) except -1:
    """Add to `result` what `strengthened` adds for one `motion`."""
    cdef double total = 0.0, common = 0.0, along = 0.0, ratio = 1.0, factor
    cdef double[3] gradient = [0.0, 0.0, 0.0]
    cdef Py_ssize_t i, j
    for i in range(3):
        for j in range(3):
            gradient[i] += information[i, j] * motion[j]
            total += motion[i] * seeming[i, j] * motion[j]
            common += motion[i] * shared[i, j] * motion[j]
        along += motion[i] * gradient[i]
    if total > 0.0:
        ratio = total / max(common, MIN_SHARED_RATIO * total)
    factor = max(ratio - 1.0, 0.0) / max(along, TINY)
    for i in range(3):
        for j in range(3):
            result[i, j] += factor * gradient[i] * gradient[j]
    return 0


@cython.boundscheck(False)
cdef double[:, ::1] residuals(Correspondences found, OrientedPoints points, const double *step, double theta,
                              bint scattered):
    """Return ``(8, M)``: error, weight and Jacobian of the pairs after a `step`, and the Jacobian of their points.

    The latter is computed with the points' own normals, of a scan with the heading `theta` [rad]. Where surfaces are
    `scattered`, their normals constrain no motion along them.
    """
    cdef double[:, ::1] table = np.empty((8, found.count)), own = np.empty((3, points.size))
    cdef double c = cos(theta), s = sin(theta), x, y
    cdef Py_ssize_t k, p
    with nogil:
        for p in range(points.size):
            x = points.normals_view[p].real * points.inverse_noise_view[p]
            y = points.normals_view[p].imag * points.inverse_noise_view[p]
            own[0, p], own[1, p] = c * x - s * y, s * x + c * y
            own[2, p] = found.turned[p].x * own[1, p] - found.turned[p].y * own[0, p]
        for k in range(found.count):
            table[0, k] = step[0] * found.a[k] + step[1] * found.b[k] + step[2] * found.r[k] + found.e[k]
            table[1, k], table[2, k], table[3, k], table[4, k] = found.weight[k], found.a[k], found.b[k], found.r[k]
            p = found.of_point[k]
            table[5, k], table[6, k], table[7, k] = own[0, p], own[1, p], own[2, p]
        if scattered:
            make_walls_parallel(table, wall_direction(table))
    return table


cdef double displacement(Correspondences found, other) except? -1.0:
    """Return the mean distance [m] by which the points move from the pose of the correspondences to another pose."""
    pose = found.pose
    cdef double dx = other.x - pose.x, dy = other.y - pose.y, t = wrap(other.theta - pose.theta)
    cdef double c = cos(t) - 1.0, s = sin(t), total = 0.0
    cdef Turned *turned
    cdef Py_ssize_t k
    for k in range(found.count):
        turned = &found.turned[found.of_point[k]]
        total += length_of(dx + c * turned.x - s * turned.y, dy + s * turned.x + c * turned.y)
    return total / max(found.count, 1)


def alignment_uncertainty(features, pose, Correspondences found, initial, p):
    """Estimate covariance and observability of a scan aligned at `pose`.

    Returns
    -------
    covariance : (3, 3) float
        In the frame of the scan [m, m, rad].
    observability : Observability
        Directions in the odometry frame.
    """
    cdef double[:, ::1] table
    start = found.pose
    cdef double[3] step = [pose.x - start.x, pose.y - start.y, wrap(pose.theta - start.theta)]
    found.weigh(step, SCORE_SCALE)
    table = residuals(found, features.oriented_points, step, pose.theta, features.scattered)
    return match_covariance(table, features.noise, p.decision, pose.theta, initial.direction is not None,
                            initial.rotation_unobservable)


def expected_observability(window, key_frame, features, pose, p):
    """Return the `Observability` to expect from the registration of a scan to one key frame, for its expected `pose`."""
    cdef Correspondences found
    cdef double[:, ::1] table
    cdef double[3] step = [0.0, 0.0, 0.0]
    points = features.sampled_points
    found = ScanLookup(window.slots, points, p.density).in_frame(window.frames.index(key_frame), pose)
    found.weigh(step, SCORE_SCALE)
    table = residuals(found, points, step, pose.theta, features.scattered)
    return match_covariance(table, features.noise, p.decision, pose.theta)[1]


def information_along(features, pose, double angle, p):
    """Return the information of the points of a scan at `pose` about the translation along `angle` [rad].

    That of points whose normal is nearly perpendicular to this direction is zero, and that of scattered surfaces.
    """
    cdef OrientedPoints points = features.oriented_points
    cdef double turn = pose.theta - angle, least = MIN_CROSSING_SINE, total = 0.0
    cdef double c = cos(turn), s = sin(turn)
    cdef Py_ssize_t k
    if features.scattered:
        return 0.0
    for k in range(points.size):
        total += point_information(points, k, c, s, least)
    return total


cdef inline double point_information(OrientedPoints points, Py_ssize_t k, double c, double s, double least) except -1.0:
    """Return the information of one point along a direction, given by its angle from the heading of the scan."""
    cdef double along = points.normals_view[k].real * c - points.normals_view[k].imag * s
    if fabs(along) < least:
        return 0.0
    along *= points.inverse_noise_view[k]
    return along * along * points.weights_view[k]


def sees_new_surface(features, pose, Correspondences found, double angle, p):
    """Whether points on surfaces that no key frame contains would constrain the translation along `angle` [rad].

    They must provide at least half of all information along this degenerate direction, because noise makes a few
    points of every wall seem new. Scattered surfaces provide none.
    """
    cdef OrientedPoints points = features.oriented_points
    cdef double[::1] known = np.zeros(points.size)
    cdef double turn = pose.theta - angle, least = MIN_CROSSING_SINE, one, total = 0.0, new = 0.0
    cdef double c = cos(turn), s = sin(turn)
    cdef double[3] step = [pose.x - found.pose.x, pose.y - found.pose.y, wrap(pose.theta - found.pose.theta)]
    cdef Py_ssize_t k
    if features.scattered:
        return False
    found.weigh(step, p.refinement.map_first_scale)
    for k in range(found.count):
        known[found.of_point[k]] += found.weight[k]
    for k in range(points.size):
        one = point_information(points, k, c, s, least)
        total += one
        new += (1.0 - known[k]) * one
    return new >= max(p.decision.min_information, 0.5 * total)
