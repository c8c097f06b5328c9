# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Key frames as the look-up of points reads them, and the look-up of a scan in all of them."""
import numpy as np

from ..features.oriented_points import high_leverage
from ..parameters import registration as constants

cimport cython
from libc.math cimport cos, fabs, sin
from libc.stdlib cimport free, malloc

from ..features.oriented_points cimport OrientedPoints
from ..features.point_weights cimport kernel, kernel_factor
from ..geometry.plane cimport length_of
from ..registration.views cimport FieldArrays, Lines, lines_of, nearest
from .correspondences cimport Correspondences, Turned

cdef double MIN_NORMAL_COSINE = constants.MIN_NORMAL_COSINE
# Each point is looked up in at least this many key frames.
cdef Py_ssize_t MIN_FRAMES_PER_POINT = 3
# The size of a subset is about `density.max_points` divided by this number.
cdef Py_ssize_t SUBSETS = 3


cdef class Slots:
    """The slots of K key frames.

    Parameters
    ----------
    frames : sequence of KeyFrame
    """

    def __cinit__(self, frames):
        cdef Lines lines
        cdef const double[::1] nearby
        cdef Slot *slot
        self.frames, self.kept, self.count = tuple(frames), [], len(frames)
        self.slots = <Slot *> malloc(max(self.count, 1) * sizeof(Slot))
        if self.slots == NULL:
            raise MemoryError
        for k, frame in enumerate(self.frames):
            slot, pose, lines = &self.slots[k], frame.pose, lines_of(frame.features.likelihood_field)
            slot.x, slot.y, slot.c, slot.s = pose.x, pose.y, cos(-pose.theta), sin(-pose.theta)
            nearby = frame.features.free_space.nearby
            slot.field, slot.nearby, slot.bins = lines.arrays, &nearby[0], nearby.shape[0]
            self.kept.append((lines, nearby))

    def __dealloc__(self):
        free(self.slots)

    def __reduce__(self):
        """Copies of the window make slots of their own."""
        return type(self), (self.frames,)


cdef class ScanLookup:
    """Looks up the points of one scan in key frames.

    Parameters
    ----------
    slots : Slots
    points : OrientedPoints
    density : DensityParameters
    """

    def __cinit__(self, Slots slots, OrientedPoints points, density):
        self.slots, self.own = slots, points
        self.max_points = density.max_points
        # One more is written, but not counted.
        self.hits = <Hit *> malloc((self.own.size + 1) * sizeof(Hit))
        if self.hits == NULL:
            raise MemoryError

    def __dealloc__(self):
        free(self.hits)

    cdef Correspondences at(self, pose):
        """Look up the lines of all key frames on which the points of the scan at a `pose` lie.

        Points of high leverage are looked up in every key frame. The others, where a scan has many, are split into
        subsets; each subset is looked up in several key frames, and each key frame looks up one.
        """
        cdef const Py_ssize_t[:, ::1] chosen
        cdef Correspondences found
        cdef Py_ssize_t k
        chosen = look_up_subsets(high_leverage(self.own.normals_view), self.own.beams_view, self.slots.count,
                                 self.max_points // SUBSETS)
        found = self.turned(pose, self.slots.count * chosen.shape[1])
        for k in range(self.slots.count):
            self.add(k, chosen[k % chosen.shape[0]], found)
        found.end()
        return found

    cdef Correspondences in_frame(self, Py_ssize_t frame, pose):
        """Look up the lines of one key frame on which the points of the scan at a `pose` lie."""
        cdef Correspondences found = self.turned(pose, self.own.size)
        self.add(frame, np.arange(self.own.size), found)
        found.end()
        return found

    cdef Correspondences turned(self, pose, Py_ssize_t most):
        """Return correspondences without pairs, and with the points rotated to a `pose` in the odometry frame (Eq. 8)."""
        cdef Correspondences found = Correspondences(self.own.size, most)
        cdef double c = cos(pose.theta), s = sin(pose.theta)
        cdef double complex point, normal
        cdef Py_ssize_t k
        found.pose, self.x, self.y = pose, pose.x, pose.y
        for k in range(self.own.size):
            point, normal = self.own.points_view[k], self.own.normals_view[k]
            found.turned[k] = Turned(c * point.real - s * point.imag, c * point.imag + s * point.real,
                                     c * normal.real - s * normal.imag, c * normal.imag + s * normal.real,
                                     self.own.inverse_noise_view[k], self.own.weights_view[k])
        return found

    @cython.boundscheck(False)
    cdef int add(self, Py_ssize_t frame, const Py_ssize_t[::1] chosen, Correspondences found) except -1 nogil:
        """Add the pairs of `chosen` points and nearest lines of a key frame.

        The normals of a pair agree, and the point lies beside the piece of line. No step depends on another or on a
        condition, so that many are under way at a time: what is no pair is overwritten by the next. No index is checked:
        `chosen` has indices of points, `found` has room, and `Lines` hold a valid table.
        """
        cdef Slot *slot = &self.slots.slots[frame]
        cdef FieldArrays *field = &slot.field
        cdef Turned *turned
        cdef Py_ssize_t i, at, hits = 0, count = found.count
        cdef double x = self.x - slot.x, y = self.y - slot.y, c = slot.c, s = slot.s, dx, dy, nx, ny
        cdef double least = MIN_NORMAL_COSINE
        cdef double complex line
        cdef bint alike, beside
        for i in range(chosen.shape[0]):
            turned = &found.turned[chosen[i]]
            dx, dy = turned.x + x, turned.y + y
            at = nearest(field, c * dx - s * dy, s * dx + c * dy)
            self.hits[hits] = Hit(chosen[i], at)
            hits += at != field.size - 1
        for i in range(hits):
            turned, at = &found.turned[self.hits[i].point], self.hits[i].line
            line = field.normals[at]
            # The conjugated normal in the odometry frame.
            nx, ny = line.real * c - line.imag * s, line.real * s + line.imag * c
            dx, dy = turned.x + x, turned.y + y
            alike = nx * turned.nx - ny * turned.ny > least
            beside = fabs(nx * dy + ny * dx - field.along[at]) <= field.extents[at]
            found.e[count] = (nx * dx - ny * dy - field.offsets[at]) * turned.inverse_noise
            nx, ny = nx * turned.inverse_noise, ny * turned.inverse_noise
            found.a[count], found.b[count], found.r[count] = nx, -ny, -(nx * turned.y + ny * turned.x)
            found.given[count] = turned.weight
            found.of_frame[count], found.of_point[count] = <int> frame, <int> self.hits[i].point
            count += alike & beside
        found.count = count
        return 0


def look_up_correspondences(window, pose, points, density):
    """Return the `Correspondences` of the `points` of a scan at a `pose` with all key frames of a window."""
    return ScanLookup(window.slots, points, density).at(pose)


def look_up_subsets(const unsigned char[::1] in_every_frame, const Py_ssize_t[::1] beams, Py_ssize_t frame_count,
                    Py_ssize_t subset_size):
    """Choose the points that are looked up in each key frame: key frame k looks up subset k modulo S.

    The subset of a point depends on its beam, so that one point more or less does not change the subsets of the others.

    Parameters
    ----------
    in_every_frame : (P,) bool
        Points that are looked up in every key frame.
    beams : (P,) int
        Beam of each point.
    frame_count : int
    subset_size : int
        Desired number of other points for each key frame.

    Returns
    -------
    (S, N) int
        Indices of points. Subsets are padded to equal size with points of their own.
    """
    cdef Py_ssize_t size = in_every_frame.shape[0], others = 0, always = 0, i, j, subset, most = 0, subsets
    for i in range(size):
        others += not in_every_frame[i]
    subsets = max(min(frame_count // MIN_FRAMES_PER_POINT, (others + subset_size - 1) // subset_size), 1)
    cdef Py_ssize_t[::1] own = np.full(size, -1, np.intp), count = np.zeros(subsets, np.intp)
    for i in range(size):
        if not in_every_frame[i]:
            own[i] = <unsigned int> beams[i] % <unsigned int> subsets
            count[own[i]] += 1
    for subset in range(subsets):
        most = max(most, count[subset])
    chosen = np.empty((subsets, size - others + most), np.intp)
    cdef Py_ssize_t[:, ::1] row = chosen
    cdef Py_ssize_t[::1] end = np.zeros(subsets, np.intp)
    with nogil:
        for i in range(size):
            if own[i] < 0:
                for subset in range(subsets):
                    row[subset, always] = i
                always += 1
        for i in range(size):
            if own[i] >= 0:
                row[own[i], always + end[own[i]]] = i
                end[own[i]] += 1
        for subset in range(subsets):
            if count[subset] == 0:
                # Without points of its own, the first of any.
                j = always
                for i in range(size):
                    if own[i] >= 0 and j < always + most:
                        row[subset, j] = i
                        j += 1
            else:
                for i in range(always + count[subset], always + most):
                    row[subset, i] = row[subset, i - count[subset]]
    return chosen


def confirm(window, pose, points, double distance, double scale, density):
    """Rate how static points are: points on the lines of key frames from other positions are static.

    Parameters
    ----------
    window : KeyFrameWindow
    pose : SE2
        Pose of the scan in the odometry frame.
    points : OrientedPoints
        P points of the scan.
    distance : float [m]
        Least distance between the sensor and a key frame that is used.
    scale : float [m]
        Scale of the kernel of the distances between points and lines.
    density : DensityParameters

    Returns
    -------
    (P,) float
        Largest kernel value of each point over all key frames that are used, from 0 to 1.
    """
    cdef Slots slots = window.slots
    cdef ScanLookup lookup = ScanLookup(slots, points, density)
    cdef Py_ssize_t size = lookup.own.size, k, i
    cdef const Py_ssize_t[::1] every = np.arange(size)
    cdef double factor = kernel_factor(scale)
    cdef Correspondences found = lookup.turned(pose, size)
    confirmed = np.zeros(size)
    cdef double[::1] largest = confirmed
    for k in range(slots.count):
        if length_of(slots.slots[k].x - lookup.x, slots.slots[k].y - lookup.y) <= distance:
            continue
        found.count = 0
        lookup.add(k, every, found)
        for i in range(found.count):
            largest[found.of_point[i]] = max(largest[found.of_point[i]], kernel(found.e[i], factor))
    return confirmed
