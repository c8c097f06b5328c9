# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Views of segments and likelihood fields, and the look-up of the nearest point (Eq. 16-18)."""


cdef struct Grid:
    # Corner [m], inverse cell size [1/m], cells along x and y, bytes of an index.
    double x
    double y
    double inverse_cell
    Py_ssize_t rows
    Py_ssize_t columns
    int width


cdef struct FieldArrays:
    # The arrays of a `LikelihoodField`, and the number of its points and no point.
    Grid grid
    const unsigned char *table
    const double complex *normals
    const double *offsets
    const double *along
    const double *extents
    Py_ssize_t size


cdef class Lines:
    cdef const unsigned char[::1] table
    cdef const double complex[::1] normals
    cdef const double[::1] offsets, along, extents
    cdef FieldArrays arrays


cdef class SegmentViews:
    cdef const double[:] direction, length, sigma
    cdef const double[:, :] start, end
    cdef const Py_ssize_t[:, :] kinds
    cdef double complex[::1] middle, along
    cdef Py_ssize_t size


cdef Lines lines_of(field)
cdef SegmentViews views_of_segments(segments)


cdef inline int clipped(double cell, double last) noexcept nogil:
    """Return a coordinate as the number of a cell, the first or the `last` where it lies outside."""
    cell = cell if cell > 0.0 else 0.0
    return <int> (cell if cell < last else last)


cdef inline Py_ssize_t point_of(FieldArrays *field, Py_ssize_t row, Py_ssize_t column) noexcept nogil:
    """Return the index of the point nearest to a cell."""
    cdef Py_ssize_t cell = row * field.grid.columns + column
    if field.grid.width == 1:
        return field.table[cell]
    if field.grid.width == 2:
        return (<const unsigned short *> field.table)[cell]
    return (<const unsigned int *> field.table)[cell]


cdef inline Py_ssize_t nearest(FieldArrays *field, double x, double y) noexcept nogil:
    """Return the index of the point nearest to (x, y) [m]."""
    cdef Grid *grid = &field.grid
    return point_of(field, clipped((x - grid.x) * grid.inverse_cell, grid.rows - 1),
                    clipped((y - grid.y) * grid.inverse_cell, grid.columns - 1))
