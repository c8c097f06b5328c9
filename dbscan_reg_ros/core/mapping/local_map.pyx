# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Local map: the points of the latest key frame and the points of older key frames in its surroundings."""
import numpy as np

from ..features.oriented_points import OrientedPoints

from libc.math cimport cos, rint, sin

from ..geometry.plane cimport modulus, rotated
from ..registration.scoring cimport violation
from ..registration.views cimport PointViews, views_of


def older_map_points(older, latest, density):
    """Collect the points of older key frames that complete the latest key frame, in the frame of the latest.

    Parameters
    ----------
    older : sequence of KeyFrame
        The oldest first.
    latest : KeyFrame
    density : DensityParameters
    """
    features, samples = latest.features, [frame.features.sampled_points for frame in older]
    cdef PointViews own = views_of(features.oriented_points), views
    cdef const double[::1] near = features.free_space.near
    cdef double tolerance = density.violation_tolerance, farthest = 0.0
    cdef Py_ssize_t size = sum([len(each) for each in samples]), count = 0, number = 0, k
    vectors, numbers = np.empty((2, size), complex), np.empty((2, size), np.intp)
    cdef double complex[:, ::1] vector = vectors
    cdef Py_ssize_t[:, ::1] integer = numbers
    cdef const Py_ssize_t[::1] beams
    cdef double complex turn, shift
    for k in range(own.size):
        farthest = max(farthest, modulus(own.points[k]))
    for each in samples:
        views = views_of(each)
        for k in range(views.size):
            farthest = max(farthest, modulus(views.points[k]))
    to_latest = latest.pose.inverse()
    for frame, each in zip(older, samples):
        motion, views, beams = to_latest @ frame.pose, views_of(each), each.beams
        turn, shift = cos(motion.theta) + 1j * sin(motion.theta), motion.x + 1j * motion.y
        for k in range(views.size):
            vector[0, count] = rotated(turn, views.points[k]) + shift
            if modulus(vector[0, count]) > farthest or violation(near, vector[0, count].real, vector[0, count].imag,
                                                                 tolerance) != 0.0:
                continue
            vector[1, count] = rotated(turn, views.normals[k])
            integer[0, count], integer[1, count] = beams[k], number
            count += 1
        number += 1
    kept = newest_in_cell(vector[0, :count], integer[1, :count], own.points, density.cell_size)
    return OrientedPoints(vectors[0, :count][kept], vectors[1, :count][kept], numbers[0, :count][kept])


def newest_in_cell(const double complex[::1] points, const Py_ssize_t[::1] age_rank, const double complex[::1] latest,
                   double cell_size):
    """Return ``(P,)``: the `points` in whose cell no point has a higher rank, and none is one of the `latest`."""
    cdef Py_ssize_t size = points.shape[0], total = size + latest.shape[0], slots = 16, k, slot
    while slots < 2 * total:
        slots *= 2
    # An open hash table of cells: the key of each slot, and the highest rank seen there.
    cdef double[::1] key = np.empty(slots)
    cdef Py_ssize_t[::1] newest = np.full(slots, -1, np.intp), home = np.empty(max(size, 1), np.intp)
    kept = np.empty(size, dtype=bool)
    cdef unsigned char[::1] flag = kept
    # Cells per row of the map: larger than any map, so that each cell has a unique index.
    cdef double row = 2.0 ** 26
    with nogil:
        for k in range(latest.shape[0]):
            slot = slot_of(key, newest, rint(latest[k].real / cell_size) * row + rint(latest[k].imag / cell_size))
            newest[slot] = total
        for k in range(size):
            home[k] = slot = slot_of(key, newest,
                                     rint(points[k].real / cell_size) * row + rint(points[k].imag / cell_size))
            newest[slot] = max(newest[slot], age_rank[k])
        for k in range(size):
            flag[k] = age_rank[k] == newest[home[k]]
    return kept


cdef inline Py_ssize_t slot_of(double[::1] key, const Py_ssize_t[::1] newest, double cell) except -1 nogil:
    """Return the slot of a cell in a hash table with free slots, and claim a free one for it."""
    cdef Py_ssize_t mask = key.shape[0] - 1
    cdef Py_ssize_t slot = <Py_ssize_t> ((<unsigned long long> <long long> cell * 11400714819323198485ULL) >> 32) & mask
    while newest[slot] >= 0 and key[slot] != cell:
        slot = (slot + 1) & mask
    key[slot] = cell
    return slot
