# SPDX-License-Identifier: Apache-2.0
"""Look-up of points in all key frames at once, as `core.odometry.mapping.key_frame_window`."""


cdef class FieldTables:
    """Tables of the likelihood fields of K key frames, where the look-up finds them without a call."""

    cdef list views
    cdef Grid *grids
    cdef const unsigned char **tables
    cdef Py_ssize_t count

    def __cinit__(self, fields):
        cdef Py_ssize_t k
        cdef const unsigned char[::1] table
        self.count, self.views = len(fields), []
        self.grids = <Grid *> malloc(max(self.count, 1) * sizeof(Grid))
        self.tables = <const unsigned char **> malloc(max(self.count, 1) * sizeof(void *))
        if self.grids == NULL or self.tables == NULL:
            raise MemoryError
        for k, field in enumerate(fields):
            table = field.index.view(np.uint8)
            self.grids[k] = grid_of(field)
            if self.grids[k].rows * self.grids[k].columns * self.grids[k].width != table.shape[0] or not table.shape[0]:
                raise IndexError('a table of another size than its grid')
            self.views.append(table)
            self.tables[k] = &table[0]

    def __dealloc__(self):
        free(self.grids)
        free(self.tables)


cdef inline Py_ssize_t entry(const unsigned char *table, Grid *grid, double x, double y) noexcept nogil:
    """Return the index of the point nearest to (x, y) [m]; the cell is clipped to the grid."""
    cdef Py_ssize_t cell = (clipped((x - grid.x) * grid.inverse_cell, grid.rows) * grid.columns
                            + clipped((y - grid.y) * grid.inverse_cell, grid.columns))
    if grid.width == 1:
        return table[cell]
    if grid.width == 2:
        return (<const unsigned short *> table)[cell]
    return (<const unsigned int *> table)[cell]


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
    if stack.compiled_tables is None:
        stack.compiled_tables = FieldTables(stack.fields)
    cdef FieldTables tables = stack.compiled_tables
    cdef const double complex[::1] origins = poses.origins[:, 0], turns = poses.rotations[:, 0]
    cdef const double complex[::1] own = points.points, own_normals = points.normals, lines = stack.normals
    cdef const double[::1] offsets = stack.offsets, positions = stack.along, extents = stack.extents
    cdef const Py_ssize_t[::1] first = stack.first
    cdef Py_ssize_t frames = lookup.shape[0], width = lookup.shape[1], most = frames * width, k, i, at, p, count = 0
    numbers, vectors, errors = np.empty((2, most), np.intp), np.empty((2, most), complex), np.empty(most)
    cdef Py_ssize_t[:, ::1] number = numbers
    cdef double complex[:, ::1] vector = vectors
    cdef double[::1] error = errors
    cdef double c = cos(pose.theta), s = sin(pose.theta), x0 = pose.x, y0 = pose.y, x, y, dx, dy
    cdef double complex normal
    if frames != tables.count or frames != first.shape[0]:
        raise IndexError('a look-up for another number of key frames')
    with nogil:
        for k in range(frames):
            for i in range(width):
                p = lookup[k, i]
                x, y = c * own[p].real - s * own[p].imag, s * own[p].real + c * own[p].imag
                dx, dy = x + (x0 - origins[k].real), y + (y0 - origins[k].imag)
                at = entry(tables.tables[k], &tables.grids[k], turns[k].real * dx - turns[k].imag * dy,
                           turns[k].imag * dx + turns[k].real * dy)
                at += first[k]
                # The conjugated normal in the odometry frame; that of no point is 0.
                normal = rotated(lines[at], turns[k])
                if not (normal.real * (c * own_normals[p].real - s * own_normals[p].imag)
                        - normal.imag * (s * own_normals[p].real + c * own_normals[p].imag) > min_cosine):
                    continue
                if lines[at].real == 0.0 and lines[at].imag == 0.0:
                    continue
                if not fabs(normal.real * dy + normal.imag * dx - positions[at]) <= extents[at]:
                    continue
                number[0, count], number[1, count] = k, p
                vector[0, count], vector[1, count] = x + 1j * y, normal
                error[count] = normal.real * dx - normal.imag * dy - offsets[at]
                count += 1
    pairs = Pairs(*numbers[:, :count], *vectors[:, :count], errors[:count])
    if points.inverse_noise is None:
        return pairs
    inverse_noise = points.inverse_noise.take(pairs.point)
    return pairs._replace(normals=pairs.normals * inverse_noise, error=pairs.error * inverse_noise)


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
    subsets = max(min(frame_count // window_steps._MIN_FRAMES_PER_POINT, (others + subset_size - 1) // subset_size), 1)
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
