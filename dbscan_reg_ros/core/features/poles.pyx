# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Small objects of a scan, and poles: small objects without normals, such as chair legs and tree trunks."""
import math

import numpy as np

from ..geometry import tolerance
from ..geometry.se2 import moduli, rotated
from .small_objects import SmallObjects

from libc.math cimport fabs
from libc.stdlib cimport free, malloc

from ..geometry.plane cimport distance, modulus, vector
from .oriented_points cimport OrientedPoints
from .point_weights cimport pole_weight
from .records cimport Features
from .surfaces cimport DEPTH_MARGIN, BreakLimits, break_limits, is_break

cdef double SIGMAS = tolerance.SIGMAS, TINY = tolerance.TINY


cdef struct SmallObject:
    # As of `SmallObjects`.
    Py_ssize_t beam
    Py_ssize_t returns
    double nearest
    double complex front
    double width
    bint without_normals


cdef struct Circle:
    # Points in beam order, from a break on if the beams cover the full circle: the index of the first, the number of
    # points and of beams in the full circle, whether the beams cover it, and their step [rad].
    const double complex *points
    const double complex *normals
    const Py_ssize_t *beams
    const unsigned char *breaks
    Py_ssize_t start, size, beams_around
    bint closed
    double increment


cdef inline Py_ssize_t place_of(const Circle *circle, Py_ssize_t k) noexcept nogil:
    """Return the index of the point with this number in the order of the circle."""
    return k + circle.start if k + circle.start < circle.size else k + circle.start - circle.size


cdef inline double complex point_of(const Circle *circle, Py_ssize_t k) noexcept nogil:
    """Return a point."""
    return circle.points[place_of(circle, k)]


cdef inline Py_ssize_t beam_of(const Circle *circle, Py_ssize_t k) noexcept nogil:
    """Return the beam of a point; beams count on where they begin again."""
    return circle.beams[place_of(circle, k)] + (circle.beams_around if k + circle.start >= circle.size else 0)


cdef bint is_cut(const Circle *circle, Py_ssize_t k, BreakLimits *limits) noexcept nogil:
    """Return whether a point and the next one lie on different surfaces."""
    cdef double complex first, second
    if k + circle.start != circle.size - 1:
        return circle.breaks[place_of(circle, k)]
    first, second = point_of(circle, k), point_of(circle, k + 1)
    return is_break(distance(second, first), beam_of(circle, k + 1) - beam_of(circle, k),
                    min(modulus(second), modulus(first)), limits)


cdef Circle circle_of(Features features) except *:
    """Return the `Circle` of a scan."""
    cdef Circle circle
    cdef const double[:, ::1] points = features.points, normals = features.normals
    cdef const Py_ssize_t[::1] beams = features.beams
    cdef const unsigned char[::1] breaks = features.breaks
    cdef Py_ssize_t start = 0, cuts = breaks.shape[0]
    geometry = features.measured.geometry
    circle.points, circle.normals = <double complex *> &points[0, 0], <double complex *> &normals[0, 0]
    circle.beams, circle.breaks = &beams[0], &breaks[0] if cuts else NULL
    circle.size, circle.closed = beams.shape[0], geometry.closed
    if not (circle.size == points.shape[0] == normals.shape[0] == cuts + 1):
        raise ValueError('arrays of different lengths')
    circle.increment = fabs(geometry.angle_increment)
    circle.beams_around = round(2.0 * math.pi / circle.increment) if circle.closed else geometry.size
    while start < cuts and not circle.breaks[start]:
        start += 1
    circle.start = start + 1 if circle.closed and start < cuts else 0
    return circle


cdef Py_ssize_t find_objects(Features features, double size, parameters, SmallObject *found) except -1:
    """Write the `find_small_objects` of a scan, at most one for each point; return their number."""
    cdef Circle circle = circle_of(features)
    cdef BreakLimits limits = break_limits(circle.increment, features.noise, parameters)
    cdef double margin = DEPTH_MARGIN + SIGMAS * features.noise
    cdef Py_ssize_t count = 0, first = 0, end, last, before, after, k
    cdef double complex start, stop
    cdef SmallObject *thing
    while first < circle.size:
        end = first + 1
        while end < circle.size and not is_cut(&circle, end - 1, &limits):
            end += 1
        last, before, after = end - 1, (first if first else circle.size) - 1, end if end < circle.size else 0
        start, stop = point_of(&circle, first), point_of(&circle, last)
        if ((circle.closed or (first and end < circle.size)) and distance(stop, start) < size
                and is_behind(&circle, before, first, beam_of(&circle, first) - beam_of(&circle, before), margin)
                and is_behind(&circle, after, last, beam_of(&circle, after) - beam_of(&circle, last), margin)):
            thing = &found[count]
            thing.front = vector(0.5 * (start.real + stop.real), 0.5 * (start.imag + stop.imag))
            thing.beam, thing.returns = modulo(beam_of(&circle, first), circle.beams_around), end - first
            thing.width = (end - first) * circle.increment * modulus(thing.front)
            thing.nearest, thing.without_normals = modulus(start), True
            for k in range(first, end):
                thing.nearest = min(thing.nearest, modulus(point_of(&circle, k)))
                thing.without_normals &= circle.normals[place_of(&circle, k)] == 0.0
            count += 1
        first = end
    return count


cdef inline bint is_behind(const Circle *circle, Py_ssize_t other, Py_ssize_t own, Py_ssize_t gap,
                           double margin) noexcept nogil:
    """Return whether another point is farther away than an own one, or beams of the `gap` have no return."""
    return (modulus(point_of(circle, other)) > modulus(point_of(circle, own)) + margin
            or modulo(gap, circle.beams_around) > 1)


def find_small_objects(Features features, double size, parameters):
    """Find surfaces (Eq. 5) smaller than a `size` [m] with a larger range, or no return, on both sides."""
    cdef Py_ssize_t count
    cdef SmallObject *found = <SmallObject *> malloc(len(features.beams) * sizeof(SmallObject))
    if found == NULL:
        raise MemoryError
    try:
        count = find_objects(features, size, parameters, found)
        return small_objects(found, count)
    finally:
        free(found)


cdef small_objects(SmallObject *found, Py_ssize_t count):
    """Return objects as `SmallObjects`."""
    cdef Py_ssize_t k
    return SmallObjects(np.array([found[k].beam for k in range(count)], np.intp),
                        np.array([found[k].returns for k in range(count)], np.intp),
                        np.array([found[k].nearest for k in range(count)], float),
                        np.array([found[k].front for k in range(count)], complex),
                        np.array([found[k].width for k in range(count)], float),
                        np.array([found[k].without_normals for k in range(count)], bool))


cpdef Features with_poles(Features features, double size, parameters):
    """Add the poles of a scan as oriented points on a circle around each pole, facing away from its centre.

    A small object none of whose points has a normal is a pole. A point with a normal constrains the motion across its
    surface; a pole constrains it in every direction. A pole is assumed to be round and as wide as its beams, at most
    `size`.

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
    cdef Py_ssize_t size_of = normals.shape[0], count = 0, poles = 0, k
    cdef SmallObject *found
    for k in range(size_of):
        count += normals[k, 0] == 0.0 and normals[k, 1] == 0.0
    if not count:
        return features
    found = <SmallObject *> malloc(size_of * sizeof(SmallObject))
    if found == NULL:
        raise MemoryError
    try:
        count = find_objects(features, size, parameters, found)
        for k in range(count):
            found[poles] = found[k]
            poles += found[k].without_normals
        if not poles:
            return features
        return features.with_points_of(features.normals, points_around(small_objects(found, poles), size),
                                       features.weights, features.noise_ratio)
    finally:
        free(found)


_POINTS = 8
"""Number of oriented points around a pole."""
_AROUND = 2.0 * np.pi * np.arange(_POINTS) / _POINTS
"""Directions [rad] from the centre of a pole to its oriented points, the first one towards the sensor."""


def points_around(poles, double size):
    """Return the `OrientedPoints` around `SmallObjects` that are poles, at most as wide as a `size` [m]."""
    half = np.minimum(0.5 * poles.width, 0.5 * size)
    towards = -poles.front / np.maximum(moduli(poles.front), TINY)
    normals = rotated(towards[:, None], _AROUND)
    points = (poles.front - half * towards)[:, None] + half[:, None] * normals
    weights = np.array([pole_weight(returns, _POINTS) for returns in poles.returns])
    return OrientedPoints(points.ravel(), normals.ravel(), poles.beam.repeat(_POINTS), weights.repeat(_POINTS))


cdef inline Py_ssize_t modulo(Py_ssize_t number, Py_ssize_t of) noexcept nogil:
    """Return the remainder, which is not negative."""
    return (number % of + of) % of
