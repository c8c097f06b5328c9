# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3
"""Typed access to `OrientedPoints`."""


cdef enum:
    # Where the same is done with all points, in loops one after another, it is done with so many at a time.
    BLOCK = 256


cdef class OrientedPoints:
    cdef readonly object points, normals, beams, weights, inverse_noise
    # The same arrays for compiled steps, with ones where `weights` or `inverse_noise` is None; their length.
    cdef const double complex[::1] points_view, normals_view
    cdef const Py_ssize_t[::1] beams_view
    cdef const double[::1] weights_view, inverse_noise_view
    cdef Py_ssize_t size
    cdef dict __dict__

    cdef OrientedPoints first(self, Py_ssize_t count)


cdef const double[::1] given_or_ones(values, Py_ssize_t size)
cdef OrientedPoints oriented_with_poles(const double[:, ::1] place, const double[:, ::1] facing,
                                        const Py_ssize_t[::1] of, OrientedPoints poles, weights, double noise_scale)
