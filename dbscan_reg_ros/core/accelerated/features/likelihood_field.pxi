# SPDX-License-Identifier: Apache-2.0
"""Likelihood field of a scan (Eq. 16-18), as `core.features.likelihood_field`."""

ctypedef unsigned char Index1
ctypedef unsigned short Index2
ctypedef unsigned int Index4
ctypedef fused Index:
    Index1
    Index2
    Index4


def build_likelihood_field(oriented, parameters):
    """Build the `LikelihoodField` of oriented points."""
    cdef const double complex[::1] points = np.ascontiguousarray(oriented.points)
    cdef const double complex[::1] known = np.ascontiguousarray(oriented.normals)
    cdef Py_ssize_t size = points.shape[0], k
    cdef double x_low = 0.0, y_low = 0.0, x_high = 0.0, y_high = 0.0, gap
    if size:
        x_low = x_high = points[0].real
        y_low = y_high = points[0].imag
    for k in range(1, size):
        x_low, x_high = min(x_low, points[k].real), max(x_high, points[k].real)
        y_low, y_high = min(y_low, points[k].imag), max(y_high, points[k].imag)
    reach, wide = parameters.max_distance, (x_high - x_low, y_high - y_low)
    cell = max(parameters.cell_size, (max(wide) + 2.0 * reach) / parameters.max_cells)
    # One cell for rounding, and a border of cells without a point: lookups beyond the grid end there.
    margin = math.ceil(reach / cell) + 2
    origin = complex(x_low, y_low) - complex(margin, margin) * cell
    shape = tuple([int(side / cell) + 2 * margin + 1 for side in wide])
    table = np.full(shape[0] * shape[1], size, dtype=np.min_scalar_type(size))
    rows, columns = likelihood_field_steps._disc(reach / cell)
    offsets = np.ascontiguousarray(rows * shape[1] + columns)
    if table.itemsize == 1:
        write_nearest[Index1](table, points, origin, cell, shape[1], offsets)
    elif table.itemsize == 2:
        write_nearest[Index2](table, points, origin, cell, shape[1], offsets)
    else:
        write_nearest[Index4](table, points, origin, cell, shape[1], offsets)
    lines, numbers = np.zeros(size + 1, complex), np.zeros((3, size + 1))
    cdef double complex[::1] normal = lines
    cdef double[:, ::1] number = numbers
    for k in range(size):
        normal[k] = known[k].conjugate()
        number[0, k], number[1, k] = dot(known[k], points[k]), cross(known[k], points[k])
        gap = INFINITY
        if k:
            gap = distance(points[k], points[k - 1])
        if k + 1 < size:
            gap = min(gap, distance(points[k + 1], points[k]))
        number[2, k] = max(gap, <double> cell)
    number[2, size] = cell
    return LikelihoodField(origin=origin, cell=cell, shape=shape, index=table, normals=lines, offsets=numbers[0],
                           along=numbers[1], extents=numbers[2])


cdef int write_nearest(Index[::1] table, const double complex[::1] points, double complex origin, double cell,
                       Py_ssize_t columns, const Py_ssize_t[:, ::1] offsets) except -1:
    """Write the index of the nearest point to every cell within reach of one.

    Of the points in one cell only the one closest to its centre is written. Discs are written from far to near, so that
    the nearest point remains. Their `offsets` (K, 4) depend on the quarter of the cell in which the point lies: a fixed
    order among equals would bias every match in one direction.
    """
    cdef Py_ssize_t size = points.shape[0], k, at, row, column, disc, winners = 0
    cdef Py_ssize_t[::1] home = np.empty(size, np.intp), quarter = np.empty(size, np.intp)
    cdef Py_ssize_t[::1] order = np.empty(size, np.intp), scratch = np.empty(size, np.intp)
    cdef Py_ssize_t[::1] cell_of = np.empty(size, np.intp), quarter_of = np.empty(size, np.intp)
    cdef double[::1] closeness = np.empty(size)
    cdef Py_ssize_t[4] shift
    cdef double x, y
    with nogil:
        for k in range(size):
            x, y = (points[k].real - origin.real) / cell, (points[k].imag - origin.imag) / cell
            row, column = <Py_ssize_t> x, <Py_ssize_t> y
            x, y = x - row - 0.5, y - column - 0.5
            home[k], quarter[k], closeness[k] = row * columns + column, 2 * (x > 0.0) + (y > 0.0), -(x * x + y * y)
        sort_stably(closeness, order, scratch)
        for k in range(size):
            table[home[order[k]]] = <Index> order[k]
        for k in range(size):
            if <Py_ssize_t> table[home[order[k]]] == order[k]:
                order[winners] = order[k]
                winners += 1
        for k in range(winners):
            cell_of[k], quarter_of[k] = home[order[k]], quarter[order[k]]
        for disc in range(offsets.shape[0]):
            for k in range(4):
                shift[k] = offsets[disc, k]
            for k in range(winners):
                table[cell_of[k] + shift[quarter_of[k] & 3]] = <Index> order[k]
    return 0
