# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Key frames as the look-up of points reads them, and the look-up of a scan in all of them."""
import numpy as np

from ..features.oriented_points import high_leverage

from libc.math cimport cos, fabs, sin
from libc.stdlib cimport free, malloc

from ..features.oriented_points cimport OrientedPoints
from ..geometry.exponential cimport decaying_exp
from ..geometry.plane cimport length_of
from ..registration.views cimport FieldArrays, Lines, lines_of, nearest
from .correspondences cimport Correspondences, Pair

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

    def __len__(self):
        return self.count

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
        self.slots, self.own, self.density = slots, points, density
        self.min_cosine = density.min_normal_cosine
        self.turned = <Turned *> malloc(max(self.own.size, 1) * sizeof(Turned))
        self.nearest = <Py_ssize_t *> malloc(max(self.own.size, 1) * sizeof(Py_ssize_t))
        if self.turned == NULL or self.nearest == NULL:
            raise MemoryError

    def __dealloc__(self):
        free(self.turned)
        free(self.nearest)

    cdef Correspondences at(self, pose):
        """Look up the lines of all key frames on which the points of the scan at a `pose` lie.

        Points of high leverage are looked up in every key frame. The others, where a scan has many, are split into
        subsets; each subset is looked up in several key frames, and each key frame looks up one.
        """
        cdef const Py_ssize_t[:, ::1] chosen
        cdef Correspondences found
        cdef Py_ssize_t k
        if self.subsets is None:
            self.subsets = look_up_subsets(high_leverage(self.own.normals), self.own.beams_view, self.slots.count,
                                           self.density.max_points // SUBSETS)
        chosen = self.subsets
        found = Correspondences(pose, self.own.size, self.slots.count * chosen.shape[1])
        self.turn(pose)
        for k in range(self.slots.count):
            found.count += self.add(k, chosen[k % chosen.shape[0]], &found.pairs[found.count])
        return found

    cdef Correspondences in_frame(self, Py_ssize_t frame, pose):
        """Look up the lines of one key frame on which the points of the scan at a `pose` lie."""
        cdef Correspondences found = Correspondences(pose, self.own.size, self.own.size)
        self.turn(pose)
        found.count = self.add(frame, np.arange(self.own.size), found.pairs)
        return found

    cdef int turn(self, pose) except -1:
        """Rotate points and normals to a `pose` of the scan in the odometry frame (Eq. 8)."""
        cdef double c = cos(pose.theta), s = sin(pose.theta)
        cdef double complex point, normal
        cdef Py_ssize_t k
        self.x, self.y = pose.x, pose.y
        for k in range(self.own.size):
            point, normal = self.own.points_view[k], self.own.normals_view[k]
            self.turned[k] = Turned(c * point.real - s * point.imag, c * point.imag + s * point.real,
                                    c * normal.real - s * normal.imag, c * normal.imag + s * normal.real)
        return 0

    cdef Py_ssize_t add(self, Py_ssize_t frame, const Py_ssize_t[::1] chosen, Pair *pairs) except -1 nogil:
        """Write the pairs of `chosen` points and nearest lines of a key frame; return their number.

        The normals of a pair agree, and the point lies beside the piece of line. No look-up depends on another or on a
        condition, so that many are under way at a time.
        """
        cdef Slot *slot = &self.slots.slots[frame]
        cdef FieldArrays *field = &slot.field
        cdef Turned *turned
        cdef Pair *pair
        cdef Py_ssize_t i, p, at, count = 0
        cdef double x = self.x - slot.x, y = self.y - slot.y, dx, dy, nx, ny, noise
        cdef double complex line
        if frame >= self.slots.count or chosen.shape[0] > self.own.size:
            raise IndexError('more key frames or points than expected')
        for i in range(chosen.shape[0]):
            if not 0 <= chosen[i] < self.own.size:
                raise IndexError('a look-up of a point that the scan has not')
            turned = &self.turned[chosen[i]]
            dx, dy = turned.x + x, turned.y + y
            self.nearest[i] = nearest(field, slot.c * dx - slot.s * dy, slot.s * dx + slot.c * dy)
        for i in range(chosen.shape[0]):
            p, at = chosen[i], self.nearest[i]
            if at >= field.size:
                raise IndexError('a table with an index of no point')
            line = field.normals[at]
            if line.real == 0.0 and line.imag == 0.0:
                continue
            turned = &self.turned[p]
            # The conjugated normal in the odometry frame; that of no point is 0.
            nx, ny = line.real * slot.c - line.imag * slot.s, line.real * slot.s + line.imag * slot.c
            if not nx * turned.nx - ny * turned.ny > self.min_cosine:
                continue
            dx, dy = turned.x + x, turned.y + y
            if not fabs(nx * dy + ny * dx - field.along[at]) <= field.extents[at]:
                continue
            pair, noise = &pairs[count], self.own.inverse_noise_view[p]
            pair.frame, pair.point, pair.e = frame, p, (nx * dx - ny * dy - field.offsets[at]) * noise
            nx, ny = nx * noise, ny * noise
            pair.a, pair.b, pair.r = nx, -ny, -(nx * turned.y + ny * turned.x)
            pair.x, pair.y, pair.given = turned.x, turned.y, self.own.weights_view[p]
            count += 1
        return count


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
    cdef double factor = -0.5 / (scale * scale)
    confirmed = np.zeros(size)
    cdef double[::1] largest = confirmed
    cdef Pair *pairs = <Pair *> malloc(max(size, 1) * sizeof(Pair))
    if pairs == NULL:
        raise MemoryError
    try:
        lookup.turn(pose)
        for k in range(slots.count):
            if length_of(slots.slots[k].x - lookup.x, slots.slots[k].y - lookup.y) <= distance:
                continue
            for i in range(lookup.add(k, every, pairs)):
                largest[pairs[i].point] = max(largest[pairs[i].point], decaying_exp(factor * pairs[i].e * pairs[i].e))
    finally:
        free(pairs)
    return confirmed
