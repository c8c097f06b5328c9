# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Tables of a scan as a reference: its likelihood field (Eq. 16-18) and its free-space profile."""
import math
from functools import lru_cache

import numpy as np

from ..geometry import tolerance
from .free_space import FreeSpaceProfile
from .likelihood_field import LikelihoodField

from libc.math cimport INFINITY, M_PI, atan2, fabs, rint

from ..geometry.ordering cimport bisect_right, sort_stably
from ..geometry.plane cimport cross, distance, dot, length_of

cdef double TINY = tolerance.TINY
# Largest number of cells along a side: 32 m at the least size of a cell. Larger scans have larger cells.
MAX_CELLS = 800

ctypedef fused Number:
    short
    int


def build_likelihood_field(oriented, parameters):
    """Build the `LikelihoodField` of P `OrientedPoints` [m] by `DensityParameters`; the index P is that of no point."""
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
    cell = max(parameters.cell_size, (max(wide) + 2.0 * reach) / MAX_CELLS)
    # A border of cells without a point: lookups beyond the grid end there. No point on the sides of its cell.
    margin = math.ceil(reach / cell) + 1
    border = (margin + _PART) * cell
    origin = complex(x_low - border, y_low - border)
    shape = tuple([int(side / cell) + 2 * margin + 2 for side in wide])
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


_PART = 0.381966
"""Distance of the lowest point from the side of its cell, in cells: rounding moves no point into the next one."""
_QUARTER = 0.25 + 0.26j
_QUARTERS = np.array((-_QUARTER, -_QUARTER.conjugate(), _QUARTER.conjugate(), _QUARTER))
"""Points near the middles of the quarters of a cell, in cells; off the diagonals, where rows and columns would tie."""


@lru_cache(maxsize=2)
def disc_ranks(radius):
    """Return ``(4, side, width)`` int: the rank of each cell of a disc, by its `radius` in cells, for each quarter.

    The ranks are the places in `_disc`, and -1 outside the disc. The rows are padded to whole vectors.
    """
    rows, columns = _disc(radius)
    reach, order = math.ceil(radius), np.arange(len(rows))
    kind = np.short if len(rows) <= np.iinfo(np.short).max else np.intc
    ranks = np.full((4, 2 * reach + 1, (2 * reach + 8) // 8 * 8), -1, kind)
    for quarter in range(4):
        ranks[quarter, rows[:, quarter] + reach, columns[:, quarter] + reach] = order
    return ranks


def _disc(radius):
    """Return row and column offsets ``(K, 4)`` int of the K cells of a disc with a `radius` in cells, from far to near.

    Each column is sorted by the distance from a point in one quarter of the middle cell (`_QUARTERS`).
    """
    reach = math.ceil(radius)
    side = np.arange(-reach, reach + 1)
    row, column = np.nonzero(side[:, None] ** 2 + side ** 2 <= radius * radius)
    row, column = side[row, None], side[column, None]
    order = np.argsort(-((row - _QUARTERS.real) ** 2 + (column - _QUARTERS.imag) ** 2), axis=0, kind='stable')
    return row[order, 0], column[order, 0]


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


def build_free_space_profile(const double[:, ::1] points, double increment):
    """Build the `FreeSpaceProfile` of a scan.

    A bin has information when the beams next to both of its edges have a return, at most three increments apart.

    Parameters
    ----------
    points : (P, 2) float
        Filtered points in the frame of the sensor [m].
    increment : float
        Step from one beam to the next [rad].
    """
    cdef Py_ssize_t count = points.shape[0], k, b, at, before, next_before, next_after, first = 0
    cdef bint ascending = True
    cdef Py_ssize_t size = min(max(round(2.0 * math.pi / abs(increment)), _MIN_BINS), _MAX_BINS)
    cdef double[:, ::1] work = np.empty((5, count + 2))
    cdef double *angle = &work[0, 0]
    cdef double *distance = &work[1, 0]
    cdef double[::1] bearings = work[2, :count], bearing = work[3], radius = work[4]
    cdef Py_ssize_t[:, ::1] index = np.empty((2, count), np.intp)
    cdef Py_ssize_t[::1] order = index[0]
    cdef const double[::1] edges = _edges(size)
    cdef double widest = 3.0 * max(fabs(increment), 2.0 * M_PI / size), low, high
    profile = np.zeros((2, size))
    cdef double[:, ::1] limits = profile
    if not count:
        raise IndexError('a scan without points')
    with nogil:
        # Counter-clockwise, from where the bearing jumps to -pi on, they ascend as a rule.
        for k in range(count):
            at = k if increment > 0.0 else count - 1 - k
            angle[k], distance[k] = atan2(points[at, 1], points[at, 0]), length_of(points[at, 0], points[at, 1])
            if k and not first and angle[k] < angle[k - 1]:
                first = k
        for k in range(count):
            bearings[k], order[k] = angle[first + k if first + k < count else first + k - count], k
            ascending &= k == 0 or bearings[k - 1] <= bearings[k]
        if not ascending:
            sort_stably(bearings, order, index[1])
        for k in range(count):
            at = first + order[k]
            bearing[k + 1], radius[k + 1] = bearings[order[k]], distance[at if at < count else at - count]
        bearing[0], radius[0] = bearing[count] - 2.0 * M_PI, radius[count]
        bearing[count + 1], radius[count + 1] = bearing[1] + 2.0 * M_PI, radius[1]
        before = bisect_right(bearing, count + 2, edges[0]) - 1
        for b in range(size):
            next_before = before
            while next_before + 1 < count + 2 and bearing[next_before + 1] <= edges[b + 1]:
                next_before += 1
            next_after = next_before + (bearing[next_before] < edges[b + 1])
            if bearing[next_after] - bearing[before] < widest:
                low = high = radius[next_after]
                for k in range(before, next_before + 1):
                    low, high = min(low, radius[k]), max(high, radius[k])
                limits[0, b], limits[1, b] = low, high
            before = next_before
    return FreeSpaceProfile(profile[0], profile[1])


@lru_cache(maxsize=2)
def _edges(size):
    """Return the bearings [rad] of the edges of `size` bins of the full circle."""
    return np.arange(size + 1, dtype=float) * (2.0 * math.pi / size) - math.pi


_MIN_BINS, _MAX_BINS = 60, 2880
"""Least and greatest number of bins of a free-space profile."""
