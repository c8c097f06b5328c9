# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Views of segments and likelihood fields, which are kept with them."""
import numpy as np

from libc.math cimport cos, sin


cdef Grid grid_of(field) except *:
    """Return the `Grid` of a `LikelihoodField`."""
    cdef Grid grid
    origin = field.origin
    grid.x, grid.y, grid.inverse_cell = origin.real, origin.imag, 1.0 / field.cell
    grid.rows, grid.columns = field.shape
    grid.width = field.index.itemsize
    return grid


cdef class Lines:
    """Views of a `LikelihoodField`."""

    def __cinit__(self, field):
        self.table, self.normals, self.offsets = field.index.view(np.uint8), field.normals, field.offsets
        self.along, self.extents = field.along, field.extents
        cdef Grid grid = grid_of(field)
        cdef Py_ssize_t size = self.normals.shape[0]
        if (grid.rows * grid.columns * grid.width != self.table.shape[0] or not self.table.shape[0]
                or not size or not size == self.offsets.shape[0] == self.along.shape[0] == self.extents.shape[0]):
            raise IndexError('a table of another size than its grid, or arrays of different lengths')
        if field.index.max() >= size:
            raise IndexError('a table with an index of no point')
        self.arrays = FieldArrays(grid, &self.table[0], &self.normals[0], &self.offsets[0], &self.along[0],
                                  &self.extents[0], size)

    def __reduce__(self):
        """Copies of the field make views of their own."""
        return type(None), ()


cdef class SegmentViews:
    """Views of M `Segments`; the middle and the direction of each as complex numbers."""

    def __cinit__(self, segments):
        self.direction, self.length, self.sigma = segments.direction, segments.length, segments.sigma_direction
        self.start, self.end, self.kinds = segments.start, segments.end, segments.kinds
        self.size = self.direction.shape[0]
        cdef double complex[:, ::1] numbers = np.empty((2, self.size), complex)
        self.middle, self.along = numbers[0], numbers[1]
        cdef Py_ssize_t k
        for k in range(self.size):
            self.middle[k] = (0.5 * (self.start[k, 0] + self.end[k, 0])
                              + 1j * (0.5 * (self.start[k, 1] + self.end[k, 1])))
            self.along[k] = cos(self.direction[k]) + 1j * sin(self.direction[k])

    def __reduce__(self):
        """Copies of the segments make views of their own."""
        return type(None), ()


cdef Lines lines_of(field):
    """Return the views of a `LikelihoodField`, which are kept with it."""
    return <Lines> kept_views(field, Lines)


cdef SegmentViews views_of_segments(segments):
    """Return the views of `Segments`, which are kept with them."""
    return <SegmentViews> kept_views(segments, SegmentViews)


cdef object kept_views(owner, kind):
    """Return the views of a `kind` that are kept with their owner; make them first where there are none."""
    cdef dict kept = owner.__dict__
    views = kept.get('compiled_views')
    if views is None:
        views = kept['compiled_views'] = kind(owner)
    return views
