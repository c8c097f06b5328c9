# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Small objects of a scan, and poles: small objects without normals, such as chair legs and tree trunks."""
import dataclasses
import math

import numpy as np

from ..geometry import tolerance
from .oriented_points import OrientedPoints, SmallObjects
from .surfaces import find_breaks

from libc.math cimport fabs

from ..geometry.plane cimport distance, modulus

cdef double SIGMAS = tolerance.SIGMAS, TINY = tolerance.TINY


cdef class BeamRing:
    """Points in beam order that start at a break if the beams cover the full circle."""

    cdef double complex[::1] points
    cdef Py_ssize_t[::1] beams
    # Whether a point has no normal, and whether it and the next one lie on different surfaces.
    cdef unsigned char[::1] bare, broken
    cdef Py_ssize_t size

    def __cinit__(self, features, Py_ssize_t circle, bint closed, parameters):
        cdef const double[:, :] points = features.points, normals = features.normals
        cdef const Py_ssize_t[:] beams = features.beams
        cdef const unsigned char[:] breaks = features.breaks
        cdef Py_ssize_t start = 0, k, at
        cdef unsigned char[:, ::1] flags
        self.size = points.shape[0]
        self.points, self.beams = np.empty(self.size, complex), np.empty(self.size, np.intp)
        flags = np.zeros((2, self.size), np.uint8)
        self.bare, self.broken = flags[0], flags[1]
        if closed:
            while start < breaks.shape[0] and not breaks[start]:
                start += 1
            start = start + 1 if start < breaks.shape[0] else 0
        for k in range(self.size):
            at = (k + start) % self.size
            self.points[k] = points[at, 0] + 1j * points[at, 1]
            self.bare[k], self.beams[k] = normals[at, 0] == 0.0 and normals[at, 1] == 0.0, beams[at]
            if at < start:
                self.beams[k] += circle
            if at < breaks.shape[0]:
                self.broken[k] = breaks[at]
        if start:
            k = self.size - 1 - start
            self.broken[k] = find_breaks(
                np.asarray(self.points[k:k + 2]), np.asarray(self.beams[k:k + 2]),
                features.scan.geometry.angle_increment, features.noise, parameters).item()


def find_small_objects(features, double size, parameters):
    """Find surfaces (Eq. 5) smaller than a `size` [m] with a larger range, or no return, on both sides."""
    geometry = features.scan.geometry
    cdef double increment = fabs(geometry.angle_increment)
    cdef double margin = parameters.depth_margin + SIGMAS * features.noise, width
    cdef bint closed = geometry.closed
    cdef Py_ssize_t circle = round(2.0 * math.pi / increment) if closed else geometry.size
    cdef BeamRing ring = BeamRing(features, circle, closed, parameters)
    cdef const Py_ssize_t[::1] beams = ring.beams
    cdef const double complex[::1] points = ring.points
    cdef Py_ssize_t count = points.shape[0], objects = 1, found = 0, k, i, first, last, before, after
    cdef Py_ssize_t[::1] start = np.empty(count + 1, np.intp)
    integers, distances, fronts = np.empty((2, count), np.intp), np.empty((2, count)), np.empty(count, complex)
    flags = np.empty(count, dtype=bool)
    cdef Py_ssize_t[:, ::1] integer = integers
    cdef double[:, ::1] number = distances
    cdef double complex[::1] front = fronts
    cdef unsigned char[::1] flag = flags
    with nogil:
        start[0] = 0
        for k in range(count - 1):
            if ring.broken[k]:
                start[objects] = k + 1
                objects += 1
        start[objects if count else 0] = count
        objects = objects if count else 0
        for k in range(0 if closed else 1, objects if closed else objects - 1):
            first, last = start[k], start[k + 1] - 1
            before, after = (first if k else count) - 1, start[(k + 1) % objects]
            if not (modulus(points[before]) > modulus(points[first]) + margin
                    or modulo(beams[first] - beams[before], circle) > 1):
                continue
            if not (modulus(points[after]) > modulus(points[last]) + margin
                    or modulo(beams[after] - beams[last], circle) > 1):
                continue
            if not distance(points[last], points[first]) < size:
                continue
            front[found] = 0.5 * (points[first] + points[last])
            integer[0, found], integer[1, found] = modulo(beams[first], circle), last - first + 1
            width = (last - first + 1) * increment * modulus(front[found])
            number[0, found], number[1, found], flag[found] = modulus(points[first]), width, True
            for i in range(first, last + 1):
                number[0, found] = min(number[0, found], modulus(points[i]))
                flag[found] = flag[found] and ring.bare[i]
            found += 1
    return SmallObjects(integers[0, :found], integers[1, :found], distances[0, :found], fronts[:found],
                        distances[1, :found], flags[:found])


def with_poles(features, double size, parameters):
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
    cdef const double[:, :] normals = features.normals
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


def with_poles_at(features, objects, double size):
    """Add those of the `objects` as poles that have no normals; poles are at most as wide as a `size` [m]."""
    poles = objects.without_normals.nonzero()[0]
    front, width = objects.front[poles], objects.width[poles]
    half = np.minimum(0.5 * width, 0.5 * size)
    towards = -front / np.maximum(np.abs(front), TINY)
    normals = towards[:, None] * _AROUND
    points = (front - half * towards)[:, None] + half[:, None] * normals
    weights = np.minimum(_SURFACES * objects.returns[poles] / _POINTS, 1.0)
    return dataclasses.replace(features, poles=OrientedPoints(
        points.ravel(), normals.ravel(), objects.beam[poles].repeat(_POINTS), weights.repeat(_POINTS)))


cdef inline Py_ssize_t modulo(Py_ssize_t number, Py_ssize_t of) noexcept nogil:
    """Return the remainder, which is not negative."""
    return (number % of + of) % of
