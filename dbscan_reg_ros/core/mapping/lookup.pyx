# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Look-up of points in all key frames at once."""
import numpy as np

from .correspondences import Pairs

from libc.math cimport cos, exp, fabs, sin
from libc.stdlib cimport free, malloc

from ..geometry.plane cimport modulus, rotated
from ..registration.views cimport FieldArrays, Grid, Lines, PointViews, clipped, lines_of, views_of

# Each point is looked up in at least this many key frames.
cdef Py_ssize_t MIN_FRAMES_PER_POINT = 3


cdef class FieldTables:
    """Likelihood fields of K key frames, where the look-up finds them without a call."""

    cdef list lines
    cdef FieldArrays *fields
    cdef Py_ssize_t count

    def __cinit__(self, fields):
        cdef Py_ssize_t k
        self.lines, self.count = [lines_of(field) for field in fields], len(fields)
        self.fields = <FieldArrays *> malloc(max(self.count, 1) * sizeof(FieldArrays))
        if self.fields == NULL:
            raise MemoryError
        for k in range(self.count):
            self.fields[k] = (<Lines> self.lines[k]).arrays

    def __dealloc__(self):
        free(self.fields)

    def __reduce__(self):
        """Copies of the window make tables of their own."""
        return type(None), ()


cdef inline Py_ssize_t entry(FieldArrays *field, double x, double y) noexcept nogil:
    """Return the index of the point nearest to (x, y) [m]; the cell is clipped to the grid."""
    cdef Grid *grid = &field.grid
    cdef Py_ssize_t cell = (clipped((x - grid.x) * grid.inverse_cell, grid.rows) * grid.columns
                            + clipped((y - grid.y) * grid.inverse_cell, grid.columns))
    if grid.width == 1:
        return field.table[cell]
    if grid.width == 2:
        return (<const unsigned short *> field.table)[cell]
    return (<const unsigned int *> field.table)[cell]


cdef class PairFinder:
    """Looks up points of a scan at a pose in key frames, one after the other, and collects the pairs."""

    cdef FieldTables tables
    cdef PointViews own
    cdef const double complex[:, ::1] origins, turns
    cdef double complex here
    # Points relative to the sensor and their normals, rotated into the odometry frame.
    cdef double complex[:, ::1] turned
    cdef Py_ssize_t[::1] nearest
    cdef double min_cosine
    # Of the pairs: key frame and point; rotated point and normal; error.
    cdef object numbers, vectors, errors
    cdef Py_ssize_t[:, ::1] number
    cdef double complex[:, ::1] vector
    cdef double[::1] error
    cdef Py_ssize_t count, most

    def __cinit__(self, stack, poses, pose, points, double min_cosine, Py_ssize_t width, Py_ssize_t most):
        if stack.compiled_tables is None:
            stack.compiled_tables = FieldTables(stack.fields)
        self.tables, self.own, self.min_cosine = stack.compiled_tables, views_of(points), min_cosine
        self.origins, self.turns, self.here = poses.origins, poses.rotations, pose.x + 1j * pose.y
        if not self.tables.count == self.origins.shape[0] == self.turns.shape[0]:
            raise IndexError('tables and poses of different numbers of key frames')
        self.nearest, self.count, self.most = np.empty(max(width, 1), np.intp), 0, most
        self.numbers, self.vectors = np.empty((2, most), np.intp), np.empty((2, most), complex)
        self.errors = np.empty(most)
        self.number, self.vector, self.error = self.numbers, self.vectors, self.errors
        self.turned = np.empty((2, self.own.size), complex)
        cdef double complex turn = cos(pose.theta) + 1j * sin(pose.theta)
        cdef Py_ssize_t k
        for k in range(self.own.size):
            self.turned[0, k], self.turned[1, k] = rotated(turn, self.own.points[k]), rotated(turn, self.own.normals[k])

    cdef int add(self, Py_ssize_t frame, const Py_ssize_t[::1] lookup) except -1 nogil:
        """Add the pairs of points and nearest lines of a key frame whose normals agree and that lie side by side."""
        cdef FieldArrays *field
        cdef Py_ssize_t i, p, at
        cdef double complex turn = self.turns[frame, 0], shift = self.here - self.origins[frame, 0], normal, line
        cdef double dx, dy, error
        if frame >= self.tables.count or self.count + lookup.shape[0] > self.most:
            raise IndexError('more key frames or pairs than expected')
        field = &self.tables.fields[frame]
        if not find_nearest(field, turn, shift, lookup, self.turned, self.nearest):
            raise IndexError('a look-up of a point that the scan has not')
        for i in range(lookup.shape[0]):
            p, at = lookup[i], self.nearest[i]
            if at >= field.size:
                raise IndexError('a table with an index of no point')
            line = field.normals[at]
            if line.real == 0.0 and line.imag == 0.0:
                continue
            # The conjugated normal in the odometry frame; that of no point is 0.
            normal = rotated(line, turn)
            if not normal.real * self.turned[1, p].real - normal.imag * self.turned[1, p].imag > self.min_cosine:
                continue
            dx, dy = self.turned[0, p].real + shift.real, self.turned[0, p].imag + shift.imag
            if not fabs(normal.real * dy + normal.imag * dx - field.along[at]) <= field.extents[at]:
                continue
            self.number[0, self.count], self.number[1, self.count] = frame, p
            self.vector[0, self.count] = self.turned[0, p]
            self.vector[1, self.count] = normal * self.own.inverse_noise[p]
            error = normal.real * dx - normal.imag * dy - field.offsets[at]
            self.error[self.count] = error * self.own.inverse_noise[p]
            self.count += 1
        return 0


cdef bint find_nearest(FieldArrays *field, double complex turn, double complex shift, const Py_ssize_t[::1] lookup,
                       const double complex[:, ::1] turned, Py_ssize_t[::1] nearest) noexcept nogil:
    """Write the index of the point of a key frame nearest to each of the points; return whether all are valid.

    No look-up depends on another or on a condition, so that many are under way at a time.
    """
    cdef Py_ssize_t i, p
    cdef double x, y
    if nearest.shape[0] < lookup.shape[0]:
        return False
    for i in range(lookup.shape[0]):
        p = lookup[i]
        if p < 0 or p >= turned.shape[1]:
            return False
        x, y = turned[0, p].real + shift.real, turned[0, p].imag + shift.imag
        nearest[i] = entry(field, turn.real * x - turn.imag * y, turn.imag * x + turn.real * y)
    return True


def look_up_pairs(stack, poses, pose, points, const Py_ssize_t[:, ::1] lookup, double min_cosine):
    """Look up the lines of key frame k that the points ``lookup[k]`` of a scan at `pose` lie on.

    Parameters
    ----------
    stack : LikelihoodFieldStack
        Of K key frames.
    poses : FramePoses
        Of the same key frames.
    pose : SE2
        Pose of the scan in the odometry frame.
    points : OrientedPoints
        P points of the scan.
    lookup : (K, N) int
        Indices of points.
    min_cosine : float
        Least cosine of the angle between the normals of a pair.

    Returns
    -------
    Pairs
    """
    cdef Py_ssize_t k, count
    cdef PairFinder finder = PairFinder(stack, poses, pose, points, min_cosine, lookup.shape[1],
                                        lookup.shape[0] * lookup.shape[1])
    if lookup.shape[0] != finder.tables.count:
        raise IndexError('a look-up for another number of key frames')
    with nogil:
        for k in range(lookup.shape[0]):
            finder.add(k, lookup[k])
    count = finder.count
    return Pairs(*finder.numbers[:, :count], *finder.vectors[:, :count], finder.errors[:count])


def confirm(window, pose, points, double distance, double scale, double min_cosine):
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
    min_cosine : float
        Least cosine of the angle between the normals of a point and of its line.

    Returns
    -------
    (P,) float
        Largest kernel value of each point over all key frames that are used, from 0 to 1.
    """
    cdef Py_ssize_t size = len(points), k, i
    cdef PairFinder finder = PairFinder(window.fields, window.poses, pose, points, min_cosine, size, size)
    cdef const Py_ssize_t[::1] every = np.arange(size)
    cdef double factor = -0.5 / (scale * scale)
    confirmed = np.zeros(size)
    cdef double[::1] largest = confirmed
    with nogil:
        for k in range(finder.tables.count):
            if modulus(finder.origins[k, 0] - finder.here) <= distance:
                continue
            finder.count = 0
            finder.add(k, every)
            for i in range(finder.count):
                largest[finder.number[1, i]] = max(largest[finder.number[1, i]],
                                                   exp(factor * finder.error[i] * finder.error[i]))
    return confirmed


def points_by_frame(const unsigned char[::1] in_every_frame, const Py_ssize_t[::1] beams, Py_ssize_t frame_count,
                    Py_ssize_t subset_size):
    """Choose the points that are looked up in each key frame.

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
    (frame_count, N) int
        Indices of points. Subsets are padded to equal size with points of their own.
    """
    cdef Py_ssize_t size = in_every_frame.shape[0], others = 0, always = 0, k, i, j, subset, most = 0, subsets
    for i in range(size):
        others += not in_every_frame[i]
    always = size - others
    subsets = max(min(frame_count // MIN_FRAMES_PER_POINT, (others + subset_size - 1) // subset_size), 1)
    cdef Py_ssize_t[::1] count = np.zeros(subsets, np.intp)
    for i in range(size):
        if not in_every_frame[i]:
            count[beams[i] % subsets] += 1
    for subset in range(subsets):
        most = max(most, count[subset])
    chosen = np.empty((frame_count, always + most), np.intp)
    cdef Py_ssize_t[:, ::1] row = chosen
    cdef bint any_point
    for k in range(min(frame_count, subsets)):
        subset, j = k, 0
        for i in range(size):
            if in_every_frame[i]:
                row[k, j] = i
                j += 1
        any_point = count[subset] == 0
        for i in range(size):
            if j < always + most and not in_every_frame[i] and (any_point or beams[i] % subsets == subset):
                row[k, j] = i
                j += 1
        for i in range(j, always + most):
            row[k, i] = row[k, i - count[subset]]
    # Each subset is looked up in several key frames.
    for k in range(subsets, frame_count):
        row[k, :] = row[k - subsets, :]
    return chosen
