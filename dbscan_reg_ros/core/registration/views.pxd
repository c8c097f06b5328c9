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


cdef inline Py_ssize_t clipped(double cell, Py_ssize_t size) noexcept nogil:
    """Return a coordinate as the number of a cell, the first or the last where it lies outside."""
    if not cell > 0.0:
        return 0
    return size - 1 if cell >= <double> (size - 1) else <Py_ssize_t> cell


cdef inline Py_ssize_t nearest(FieldArrays *field, double x, double y) noexcept nogil:
    """Return the index of the point nearest to (x, y) [m]."""
    cdef Grid *grid = &field.grid
    cdef Py_ssize_t cell = (clipped((x - grid.x) * grid.inverse_cell, grid.rows) * grid.columns
                            + clipped((y - grid.y) * grid.inverse_cell, grid.columns))
    if grid.width == 1:
        return field.table[cell]
    if grid.width == 2:
        return (<const unsigned short *> field.table)[cell]
    return (<const unsigned int *> field.table)[cell]
