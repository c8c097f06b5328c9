# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Small objects of a scan, and poles: small objects without normals, such as chair legs and tree trunks."""
import math

import numpy as np

from ..geometry import tolerance
from .small_objects import SmallObjects

from libc.math cimport fabs

from ..geometry.plane cimport distance, modulus, vector
from .oriented_points cimport OrientedPoints
from .records cimport Features
from .surfaces cimport BreakLimits, break_limits, is_break

cdef double SIGMAS = tolerance.SIGMAS, TINY = tolerance.TINY


cdef struct Ring:
    # Number of points and of beams in the full circle, and whether the beams cover it; step of the beams [rad].
    Py_ssize_t size, circle
    bint closed
    double increment


cdef Ring ring_of(Features features) except *:
    """Return the `Ring` of a scan."""
    cdef Ring ring
    geometry = features.measured.geometry
    ring.size, ring.closed, ring.increment = features.beams.shape[0], geometry.closed, fabs(geometry.angle_increment)
    ring.circle = round(2.0 * math.pi / ring.increment) if ring.closed else geometry.size
    return ring


cdef int unroll(Features features, Ring *ring, BreakLimits *limits, double complex[::1] points, Py_ssize_t[::1] beams,
                unsigned char[::1] bare, unsigned char[::1] broken) except -1:
    """Write the points in beam order, from a break on if the beams cover the full circle.

    `bare` is whether a point has no normal, and `broken` whether it and the next one lie on different surfaces.
    """
    cdef const double[:, ::1] place = features.points, normals = features.normals
    cdef const Py_ssize_t[::1] of = features.beams
    cdef const unsigned char[::1] breaks = features.breaks
    cdef Py_ssize_t start = 0, k, at, last
    with nogil:
        if ring.closed:
            while start < breaks.shape[0] and not breaks[start]:
                start += 1
            start = start + 1 if start < breaks.shape[0] else 0
        for k in range(ring.size):
            at = k + start if k + start < ring.size else k + start - ring.size
            points[k], beams[k] = vector(place[at, 0], place[at, 1]), of[at] + (ring.circle if at < start else 0)
            bare[k] = normals[at, 0] == 0.0 and normals[at, 1] == 0.0
            broken[k] = breaks[at] if at < breaks.shape[0] else 0
        if start:
            last = ring.size - 1 - start
            broken[last] = is_break(distance(points[last + 1], points[last]), beams[last + 1] - beams[last],
                                    min(modulus(points[last + 1]), modulus(points[last])), limits)
    return 0


def find_small_objects(Features features, double size, parameters):
    """Find surfaces (Eq. 5) smaller than a `size` [m] with a larger range, or no return, on both sides."""
    cdef Ring ring = ring_of(features)
    cdef BreakLimits limits = break_limits(ring.increment, features.noise, parameters)
    cdef double margin = parameters.depth_margin + SIGMAS * features.noise
    cdef Py_ssize_t count = ring.size, objects = 1, found = 0, k, i, first, last, before, after
    fronts, distances = np.empty(count, complex), np.empty((2, count))
    integers, flags = np.empty((2, count), np.intp), np.empty(count, dtype=bool)
    cdef double complex[::1] points = np.empty(count, complex), front = fronts
    cdef double[::1] nearest = distances[0], width = distances[1]
    cdef Py_ssize_t[:, ::1] work = np.empty((2, count + 1), np.intp)
    cdef Py_ssize_t[::1] beams = work[0], start = work[1], beam = integers[0], returns = integers[1]
    cdef unsigned char[:, ::1] marks = np.empty((2, count), np.uint8)
    cdef unsigned char[::1] bare = marks[0], broken = marks[1], without_normals = flags
    unroll(features, &ring, &limits, points, beams, bare, broken)
    with nogil:
        start[0] = 0
        for k in range(count - 1):
            if broken[k]:
                start[objects] = k + 1
                objects += 1
        start[objects] = count
        for k in range(0 if ring.closed else 1, objects if ring.closed else objects - 1):
            first, last = start[k], start[k + 1] - 1
            before, after = (first if k else count) - 1, start[k + 1] if k + 1 < objects else 0
            if not (modulus(points[before]) > modulus(points[first]) + margin
                    or modulo(beams[first] - beams[before], ring.circle) > 1):
                continue
            if not (modulus(points[after]) > modulus(points[last]) + margin
                    or modulo(beams[after] - beams[last], ring.circle) > 1):
                continue
            if not distance(points[last], points[first]) < size:
                continue
            front[found] = 0.5 * (points[first] + points[last])
            beam[found], returns[found] = modulo(beams[first], ring.circle), last - first + 1
            width[found] = (last - first + 1) * ring.increment * modulus(front[found])
            nearest[found], without_normals[found] = modulus(points[first]), True
            for i in range(first, last + 1):
                nearest[found] = min(nearest[found], modulus(points[i]))
                without_normals[found] = without_normals[found] and bare[i]
            found += 1
    return SmallObjects(integers[0, :found], integers[1, :found], distances[0, :found], fronts[:found],
                        distances[1, :found], flags[:found])


cpdef Features with_poles(Features features, double size, parameters):
    """Add the poles of a scan as oriented points on a circle around each pole, facing away from its centre.

    A small object none of whose points has a normal is a pole. A point with a normal constrains the motion across its
    surface; a pole constrains it in every direction. A pole is assumed to be round and as wide as its beams, at most
    `size`. The weights of the points that represent a pole add up to twice the weight of the pole's returns, as if each
    return lay on two surfaces.

    Parameters
    ----------
    features : Features
    size : float
        Poles are smaller than this [m].
    parameters : SegmentParameters

    Returns
    -------
    Features
        The features with poles; `features` itself if the scan has none.
    """
    cdef const double[:, ::1] normals = features.normals
    cdef Py_ssize_t k
    for k in range(normals.shape[0]):
        if normals[k, 0] == 0.0 and normals[k, 1] == 0.0:
            break
    else:
        return features
    objects = find_small_objects(features, size, parameters)
    return with_poles_at(features, objects, size) if objects.without_normals.any() else features


_POINTS = 8
"""Number of oriented points around a pole."""
_AROUND = np.exp(2j * np.pi * np.arange(_POINTS) / _POINTS)
"""Directions from the centre of a pole to its oriented points, the first one towards the sensor."""
_SURFACES = 2.0
"""Weight of a return from a pole relative to a return from a wall: a pole constrains the motion along two axes."""


cdef Features with_poles_at(Features features, objects, double size):
    """Add those of the `objects` as poles that have no normals; poles are at most as wide as a `size` [m]."""
    poles = objects.without_normals.nonzero()[0]
    front, width = objects.front[poles], objects.width[poles]
    half = np.minimum(0.5 * width, 0.5 * size)
    towards = -front / np.maximum(np.abs(front), TINY)
    normals = towards[:, None] * _AROUND
    points = (front - half * towards)[:, None] + half[:, None] * normals
    weights = np.minimum(_SURFACES * objects.returns[poles] / _POINTS, 1.0)
    found = OrientedPoints(points.ravel(), normals.ravel(), objects.beam[poles].repeat(_POINTS),
                           weights.repeat(_POINTS))
    return features.with_points_of(features.normals, found, features.weights, features.noise_ratio)


cdef inline Py_ssize_t modulo(Py_ssize_t number, Py_ssize_t of) noexcept nogil:
    """Return the remainder, which is not negative."""
    return (number % of + of) % of
