# SPDX-License-Identifier: Apache-2.0
"""Likelihood field of a scan (Eq. 16-18), as `core.features.likelihood_field`."""

ctypedef fused Number:
    short
    int


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
    ranks = disc_ranks(reach / cell)
    # A vector has twice as many numbers of 16 bits as of 32.
    if ranks.dtype == np.short and size <= np.iinfo(np.short).max:
        table = nearest_points[short](points, origin, cell, shape, ranks)
    else:
        table = nearest_points[int](points, origin, cell, shape, ranks.astype(np.intc))
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
    return LikelihoodField(origin=origin, cell=cell, shape=shape, index=table.astype(np.min_scalar_type(size)),
                           normals=lines, offsets=numbers[0], along=numbers[1], extents=numbers[2])


@lru_cache(maxsize=2)
def disc_ranks(radius):
    """Return ``(4, side, width)``: the rank of each cell of a disc, from far to near, for each quarter.

    The ranks are the places in `core.features.likelihood_field._disc`, and -1 outside the disc. The rows are padded to
    whole vectors.
    """
    rows, columns = likelihood_field_steps._disc(radius)
    reach, order = math.ceil(radius), np.arange(len(rows))
    kind = np.short if len(rows) <= np.iinfo(np.short).max else np.intc
    ranks = np.full((4, 2 * reach + 1, (2 * reach + 8) // 8 * 8), -1, kind)
    for quarter in range(4):
        ranks[quarter, rows[:, quarter] + reach, columns[:, quarter] + reach] = order
    return ranks


cdef nearest_points(const double complex[::1] points, double complex origin, double cell, shape,
                    const Number[:, :, ::1] ranks):
    """Return the index of the nearest point for every cell of a grid; of no point where none is within reach.

    Of the points in one cell only the one closest to its centre is written. A disc around each point is written where
    no disc has a higher rank, and of equal ones the last remains. The ranks depend on the quarter of the cell in which
    the point lies: a fixed order among equals would bias every match in one direction.
    """
    cdef Py_ssize_t size = points.shape[0], rows = shape[0], columns = shape[1], side = ranks.shape[1], k, r, count
    cdef Py_ssize_t width = ranks.shape[2], corner
    # The padding of the last row is beyond the grid.
    kind, cells = np.asarray(ranks).dtype, rows * columns + width
    table = np.full(cells, size, kind)
    cdef Number[::1] number = table, best = np.zeros(cells, kind)
    cdef Py_ssize_t[:, ::1] work = np.empty((5, size), np.intp)
    cdef Py_ssize_t[::1] home = work[0], quarter = work[1], winner = work[2], order = work[3]
    cdef double[:, ::1] closeness = np.empty((2, size))
    with nogil:
        place_points(points, origin, cell, rows, columns, side // 2, home, quarter, closeness[0])
        for k in range(size):
            r = number[home[k]]
            if r == size or closeness[0, k] >= closeness[0, r]:
                number[home[k]] = <Number> k
        count = 0
        for k in range(size):
            if number[home[k]] == k:
                winner[count], closeness[1, count] = k, closeness[0, k]
                count += 1
        sort_stably(closeness[1, :count], order, work[4])
        for k in range(count):
            r = winner[order[k]]
            corner = home[r] - side // 2 * (columns + 1)
            write_disc(&number[corner], &best[corner], &ranks[quarter[r], 0, 0], side, width, columns, <Number> r)
    return table[:rows * columns]


cdef int place_points(const double complex[::1] points, double complex origin, double cell, Py_ssize_t rows,
                      Py_ssize_t columns, Py_ssize_t reach, Py_ssize_t[::1] home, Py_ssize_t[::1] quarter,
                      double[::1] closeness) except -1 nogil:
    """Write the cell of each point, the quarter of the cell, and minus the squared distance from its centre, in cells.

    No disc may reach beyond the grid.
    """
    cdef Py_ssize_t k, row, column
    cdef double x, y
    for k in range(points.shape[0]):
        x, y = (points[k].real - origin.real) / cell, (points[k].imag - origin.imag) / cell
        row, column = <Py_ssize_t> x, <Py_ssize_t> y
        if not (reach <= row < rows - reach and reach <= column < columns - reach):
            raise IndexError('a point outside the grid')
        x, y = x - row - 0.5, y - column - 0.5
        home[k], quarter[k] = row * columns + column, 2 * (x > 0.0) + (y > 0.0)
        # Rounded: distances that differ by rounding only are equal.
        closeness[k] = rint((x * x + y * y) * (-1.0 / TINY))
    return 0


cdef inline void write_disc(Number *number, Number *best, const Number *rank, Py_ssize_t side, Py_ssize_t width,
                            Py_ssize_t columns, Number own) noexcept nogil:
    """Write the `own` number and rank to the cells of a disc that have no higher rank, whole vectors at a time."""
    cdef Py_ssize_t row, k
    for row in range(side):
        for k in range(width):
            number[k] = own if rank[k] >= best[k] else number[k]
            best[k] = rank[k] if rank[k] >= best[k] else best[k]
        number, best, rank = number + columns, best + columns, rank + width
