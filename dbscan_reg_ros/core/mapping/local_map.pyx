# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Local map: the points of the latest key frame and the points of older key frames in its surroundings."""
import numpy as np

from libc.math cimport cos, llrint, sin, sqrt

from ..features.free_space cimport violation
from ..features.oriented_points cimport OrientedPoints
from ..geometry.plane cimport dot, modulus, rotated
from ..registration.scoring cimport VIOLATION_TOLERANCE


def older_map_points(older, latest, density):
    """Collect the points of older key frames that complete the latest key frame, in the frame of the latest.

    Of each cell only the points of the newest key frame stay, and none where the latest key frame has one itself. Those
    in its free space, or farther away than any key frame saw, are left out.

    Parameters
    ----------
    older : sequence of KeyFrame
        The oldest first.
    latest : KeyFrame
    density : DensityParameters
    """
    features, samples = latest.features, [frame.features.sampled_points for frame in older]
    cdef OrientedPoints own = features.oriented_points, others
    cdef const double[::1] near = features.free_space.near
    cdef double tolerance = VIOLATION_TOLERANCE, side = density.cell_size, farthest
    cdef Py_ssize_t size = sum([len(each) for each in samples]), first = size, number, k
    cdef NewestInCell cells = NewestInCell(size + own.size)
    points, normals, beams = np.empty(size, complex), np.empty(size, complex), np.empty(size, np.intp)
    cdef double complex[::1] point = points, normal = normals
    cdef Py_ssize_t[::1] beam = beams
    cdef double complex turn, shift, place
    cdef Py_ssize_t slot
    to_latest = latest.pose.inverse()
    farthest = largest_square(own)
    for each in samples:
        farthest = max(farthest, largest_square(each))
    farthest = sqrt(farthest)
    for k in range(own.size):
        cells.claim(cells.slot_of(own.points_view[k], side), len(samples))
    # The newest first, from the end of the arrays on.
    for number in range(len(samples) - 1, -1, -1):
        motion, others = to_latest @ older[number].pose, samples[number]
        turn, shift = cos(motion.theta) + 1j * sin(motion.theta), motion.x + 1j * motion.y
        with nogil:
            for k in range(others.size - 1, -1, -1):
                place = rotated(turn, others.points_view[k]) + shift
                slot = cells.slot_of(place, side)
                if (cells.is_taken(slot, number) or modulus(place) > farthest
                        or violation(near, place.real, place.imag, tolerance) != 0.0):
                    continue
                cells.claim(slot, number)
                first -= 1
                point[first], normal[first] = place, rotated(turn, others.normals_view[k])
                beam[first] = others.beams_view[k]
    return OrientedPoints(points[first:], normals[first:], beams[first:])


cdef double largest_square(OrientedPoints points) except -1.0 nogil:
    """Return the squared distance [m^2] of the farthest point from the sensor."""
    cdef double largest = 0.0
    cdef Py_ssize_t k
    for k in range(points.size):
        largest = max(largest, dot(points.points_view[k], points.points_view[k]))
    return largest


cdef class NewestInCell:
    """The number of the newest key frame that has a point in each cell, as an open hash table.

    Parameters
    ----------
    most : int
        Largest number of cells.
    """

    cdef long long[::1] cell
    cdef int[::1] number
    cdef Py_ssize_t mask

    def __cinit__(self, Py_ssize_t most):
        cdef Py_ssize_t slots = 16
        while slots < 2 * most:
            slots *= 2
        self.cell, self.number, self.mask = np.empty(slots, np.longlong), np.full(slots, -1, np.intc), slots - 1

    cdef Py_ssize_t slot_of(self, double complex place, double side) except -1 nogil:
        """Return the slot of the cell with this `side` [m] in which a place lies: its own, or a free one for it."""
        # Cells per row of the map: larger than any map, so that each cell has a unique number.
        cdef long long cell = llrint(place.real / side) * (1 << 26) + llrint(place.imag / side)
        cdef Py_ssize_t slot = <Py_ssize_t> ((<unsigned long long> cell * 11400714819323198485ULL) >> 32) & self.mask
        while self.number[slot] >= 0 and self.cell[slot] != cell:
            slot = (slot + 1) & self.mask
        if self.number[slot] < 0:
            self.cell[slot] = cell
        return slot

    cdef bint is_taken(self, Py_ssize_t slot, Py_ssize_t number) except -1 nogil:
        """Whether another key frame has claimed the slot."""
        return self.number[slot] >= 0 and self.number[slot] != number

    cdef int claim(self, Py_ssize_t slot, Py_ssize_t number) except -1 nogil:
        """Write the `number` of a key frame to a slot that is not taken."""
        self.number[slot] = <int> number
        return 0
