# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
"""Table of the key frames, and the look-up of a scan in it."""
from ..features.oriented_points cimport OrientedPoints
from ..registration.views cimport FieldArrays
from .correspondences cimport Correspondences


cdef struct Slot:
    # Of a key frame: position [m] in the odometry frame, cosine and sine of minus the heading; likelihood field;
    # `FreeSpaceProfile.nearby` [m] and its number of bins.
    double x, y, c, s
    FieldArrays field
    const double *nearby
    Py_ssize_t bins


cdef class Slots:
    cdef tuple frames
    cdef list kept
    cdef Slot *slots
    cdef Py_ssize_t count


cdef struct Hit:
    # A point of a scan, and the point of a key frame that is nearest to it.
    Py_ssize_t point, line


cdef class ScanLookup:
    cdef Slots slots
    cdef OrientedPoints own
    cdef Py_ssize_t max_points
    cdef double x, y
    cdef Hit *hits

    cdef Correspondences at(self, pose)
    cdef Correspondences in_frame(self, Py_ssize_t frame, pose)
    cdef Correspondences turned(self, pose, Py_ssize_t most)
    cdef int add(self, Py_ssize_t frame, const Py_ssize_t[::1] chosen, Correspondences found) except -1 nogil
