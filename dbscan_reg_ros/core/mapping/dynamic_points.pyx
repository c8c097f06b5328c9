# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Dynamic points (people, doors, robots), which lie in free space of key frames, and movable objects."""
import numpy as np

from ..geometry import tolerance
from ..parameters.registration import SCORE_SCALE
from .lookup import confirm

from libc.math cimport INFINITY, cos, sin, sqrt

from ..features.free_space cimport PlacedPoints, write_bins
from ..features.oriented_points cimport BLOCK, OrientedPoints
from ..features.point_weights cimport movable_weight
from ..geometry.plane cimport distance, length_of, modulus
from .lookup cimport Slot, Slots

cdef double TINY = tolerance.TINY
# A movable object is static if a key frame from at least this far away [m] contains it: one that moves with the sensor
# is elsewhere.
cdef double STATIC_BASELINE = 0.5
# If more than this fraction of a group of neighbouring points lie in free space, all its points are dynamic.
cdef double MIN_RUN_RATIO = 0.3
# If at least this fraction of the static points of a scan would be dynamic, only points in free space are.
cdef double MAX_SCAN_RATIO = 0.4
# If at least this fraction of the static points lie in free space, the pose is wrong and no point is dynamic.
cdef double MAX_FREE_SPACE_RATIO = 0.2


def without_dynamic_points(features, pose, window, parameters, sensor=''):
    """Remove the dynamic points of a scan, and reduce the weights of movable objects.

    Movable objects and poles keep their weight if a key frame from another position contains them at the same place.

    Parameters
    ----------
    features : Features
    pose : SE2
        Pose of the scan in the odometry frame.
    window : KeyFrameWindow
    parameters : Parameters
    sensor : str
        Name of the sensor of the scan. Only its own key frames show free space: a lidar at another height sees over
        what this one sees.
    """
    p = parameters.odometry
    features, candidates = _remove_dynamic(features, pose, window.of_sensor(sensor), parameters)
    walls = features.wall_points
    movable = candidates.nonzero()[0]
    sizes = candidates[movable]
    if len(movable) and information_ratio(walls, movable) < p.movable_information_ratio:
        movable, sizes = movable[:0], sizes[:0]
    if features.poles:
        poles = np.arange(len(walls), len(features.oriented_points))
        movable, sizes = np.concatenate((movable, poles)), np.concatenate((sizes, np.ones(len(poles))))
    if not len(movable):
        return features
    points = features.oriented_points.select(movable)
    confirmed = confirm(window, pose, points, STATIC_BASELINE, SCORE_SCALE, parameters.density)
    return features.downweighted(movable, [movable_weight(size, each) for size, each in zip(sizes, confirmed)])


def _remove_dynamic(features, pose, window, parameters):
    """Remove the dynamic points; also return the `detached_points` of the remaining walls, those beside dynamic ones 1."""
    p, walls = parameters.odometry, features.wall_points
    points = features.oriented_points
    movable = detached_points(walls, p.movable_size, p.dynamic_margin, features.measured.geometry.closed)
    if not p.dynamic_key_frames:
        return features, movable
    static = np.ones(len(points), dtype=bool)
    static[:len(walls)] = movable == 0
    dynamic = dynamic_points(points, pose, window, p.dynamic_key_frames, p.dynamic_margin, static)
    if not dynamic.any():
        return features, movable
    removed = dynamic[:len(walls)]
    movable = np.maximum(movable, beside(walls, removed, p.dynamic_margin))[~removed]
    return features.without(dynamic), movable


def dynamic_points(OrientedPoints points, pose, window, Py_ssize_t frames, double margin, const unsigned char[::1] static):
    """Determine which points of a scan are dynamic.

    Points in free space are dynamic, and so is a run of neighbours many of which are. Where most of the static points
    seem to be dynamic the pose is wrong, and no point is; unless only a few of them lie in free space, as of a person
    beside a long wall: then the points in free space alone are dynamic.

    Parameters
    ----------
    points : OrientedPoints
        P points in beam order.
    pose : SE2
        Predicted pose of the scan in the odometry frame.
    window : KeyFrameWindow
    frames : int
        Number of the latest key frames whose free space is used.
    margin : float [m]
        Least distance in front of what a key frame saw; and between neighbours of two runs.
    static : (P,) bool
        Points that do not belong to movable objects. If there are none, all points count as static.

    Returns
    -------
    (P,) bool
    """
    cdef const double complex[::1] own = points.points_view
    cdef Py_ssize_t size = own.shape[0], start = 0, end, k, free = 0, inside, total = 0, judged = 0, judged_free = 0
    in_free_space = contains(points, pose, window.slots, frames, margin)
    cdef const unsigned char[::1] flag = in_free_space
    for k in range(size):
        free += flag[k]
        judged += static[k]
    if not free:
        return in_free_space
    cdef bint every = not judged
    if every:
        judged = size
    dynamic = in_free_space.copy()
    cdef unsigned char[::1] moves = dynamic
    cdef double least = MIN_RUN_RATIO
    with nogil:
        while start < size:
            end, inside = start, 0
            while end < size and (end == start or distance(own[end], own[end - 1]) <= margin):
                inside += flag[end]
                end += 1
            for k in range(start, end):
                moves[k] = flag[k] or <double> inside / <double> (end - start) > least
                if every or static[k]:
                    total += moves[k]
                    judged_free += flag[k]
            start = end
    if <double> total / judged < MAX_SCAN_RATIO:
        return dynamic
    few = <double> judged_free / judged < MAX_FREE_SPACE_RATIO
    return in_free_space if few else np.zeros_like(in_free_space)


cdef contains(OrientedPoints points, pose, Slots slots, Py_ssize_t frames, double margin):
    """Return which points of a scan lie in space that one of the latest key frames saw to be free."""
    cdef Py_ssize_t first = 0, i, k
    cdef double c = cos(pose.theta), s = sin(pose.theta), x0 = pose.x, y0 = pose.y, dx, dy
    cdef const double *own = <const double *> &points.points_view[0] if points.size else NULL
    cdef const double[::1] inverse_noise = points.inverse_noise_view
    cdef double[BLOCK] x, y, distances
    cdef PlacedPoints seen
    cdef Slot *slot
    flags = np.zeros(points.size, dtype=bool)
    cdef unsigned char[::1] flag = flags
    with nogil:
        while first < points.size:
            seen.size = min(BLOCK, points.size - first)
            for i in range(seen.size):
                dx, dy = own[2 * (first + i)], own[2 * (first + i) + 1]
                x[i], y[i] = c * dx - s * dy + x0, s * dx + c * dy + y0
            for k in range(max(slots.count - frames, 0), slots.count):
                slot = &slots.slots[k]
                for i in range(seen.size):
                    dx, dy = x[i] - slot.x, y[i] - slot.y
                    seen.x[i], seen.y[i] = slot.c * dx - slot.s * dy, slot.s * dx + slot.c * dy
                    distances[i] = length_of(dx, dy)
                write_bins(&seen, slot.bins)
                for i in range(seen.size):
                    flag[first + i] |= slot.nearby[seen.bin[i]] - distances[i] > margin / inverse_noise[first + i]
            first += BLOCK
    return flags


def detached_points(OrientedPoints points, double size, double margin, bint closed):
    """Count the points of small detached objects: free space, or the end of the scan, is on both sides.

    Parameters
    ----------
    points : OrientedPoints
        P points in beam order.
    size : float [m]
        Objects are smaller than this.
    margin : float [m]
        Least difference in depth on both sides; and least distance between neighbours of two objects.
    closed : bool
        Whether the beams cover the full circle, so that the first follows the last.

    Returns
    -------
    (P,) float
        Number of points of the object that each point belongs to; 0 for those of other surfaces.
    """
    cdef const double complex[::1] own = points.points_view
    cdef Py_ssize_t count = own.shape[0], shift = 0, start, end, k, seen = 0
    detached = np.zeros(count)
    cdef double[::1] counted = detached
    cdef double near_before, near_after
    cdef bint joined
    if not count:
        return detached
    with nogil:
        joined = closed and distance(own[0], own[count - 1]) <= margin
        if joined:
            # Begin at the first cut, so that no object continues from the last point to the first.
            shift = 1
            while shift < count and distance(own[shift], own[shift - 1]) <= margin:
                shift += 1
            shift %= count
        while seen < count:
            start, end = (seen + shift) % count, seen + 1
            while end < count and distance(own[(end + shift) % count], own[(end + shift - 1) % count]) <= margin:
                end += 1
            near_before = near_after = INFINITY
            if closed or seen:
                near_before = modulus(own[(start + count - 1) % count])
            if closed or end < count:
                near_after = modulus(own[(end + shift) % count])
            if (extent(own, start, end - seen) < size and near_before > modulus(own[start]) + margin
                    and near_after > modulus(own[(end + shift - 1) % count]) + margin):
                for k in range(seen, end):
                    counted[(k + shift) % count] = end - seen
            seen = end
    return detached


cdef double extent(const double complex[::1] points, Py_ssize_t start, Py_ssize_t count) except -1.0 nogil:
    """Return the diagonal of the box around `count` points from `start` on, cyclically."""
    cdef double complex point = points[start]
    cdef double left = point.real, right = point.real, low = point.imag, high = point.imag
    cdef Py_ssize_t k
    for k in range(start + 1, start + count):
        point = points[k % points.shape[0]]
        left, right = min(left, point.real), max(right, point.real)
        low, high = min(low, point.imag), max(high, point.imag)
    return length_of(right - left, high - low)


def beside(OrientedPoints points, const unsigned char[::1] dynamic, double margin):
    """Determine which points lie close to dynamic points: most likely the rest of an object that touches a wall.

    Parameters
    ----------
    points : OrientedPoints
        P points in beam order.
    dynamic : (P,) bool
    margin : float [m]
        Largest distance from the last dynamic point before a point, or from the first after it.

    Returns
    -------
    (P,) bool
    """
    cdef const double complex[::1] own = points.points_view
    cdef Py_ssize_t size = own.shape[0], k, last = -1
    near = np.zeros(size, dtype=bool)
    cdef unsigned char[::1] flag = near
    with nogil:
        for k in range(size):
            if dynamic[k]:
                last = k
            flag[k] = last >= 0 and distance(own[last], own[k]) <= margin
        last = -1
        for k in range(size - 1, -1, -1):
            if dynamic[k]:
                last = k
            flag[k] = flag[k] or (last >= 0 and distance(own[last], own[k]) <= margin)
    return near


def information_ratio(OrientedPoints points, const Py_ssize_t[::1] chosen):
    """Return the fraction of the information about the translation that the chosen points provide.

    Parameters
    ----------
    points : OrientedPoints
    chosen : (C,) int array
        Indices of points.

    Returns
    -------
    float
        Largest fraction over all directions of the translation, from 0 to 1: the largest generalised eigenvalue.
    """
    cdef const double complex[::1] normals = points.normals_view
    cdef double xx = 0.0, xy = 0.0, yy = 0.0, part_xx = 0.0, part_xy = 0.0, part_yy = 0.0, determinant, half, product
    cdef Py_ssize_t k
    cdef double complex n
    for k in range(normals.shape[0]):
        n = normals[k]
        xx, xy, yy = xx + n.real * n.real, xy + n.real * n.imag, yy + n.imag * n.imag
    for k in range(chosen.shape[0]):
        n = normals[chosen[k]]
        part_xx, part_xy, part_yy = part_xx + n.real * n.real, part_xy + n.real * n.imag, part_yy + n.imag * n.imag
    determinant = max(xx * yy - xy * xy, TINY)
    half = 0.5 * (xx * part_yy - 2.0 * xy * part_xy + yy * part_xx) / determinant
    product = (part_xx * part_yy - part_xy * part_xy) / determinant
    return half + sqrt(max(half * half - product, 0.0))
