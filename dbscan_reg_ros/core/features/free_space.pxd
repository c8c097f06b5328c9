# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, wraparound=False, cdivision=True
"""Points in the free-space profile of a scan: all bins of a block of points by loops without branches."""
from ..geometry.plane cimport bin_of, exact_bin, length_of, rough_bin
from .oriented_points cimport BLOCK


cdef struct PlacedPoints:
    # Of each point of a block: place in the frame of the scan [m]; bin of the profile and `near` there [m]; and the
    # violation of its free space, from 0 to 1, as `in_front` has it.
    Py_ssize_t size
    double[BLOCK] x
    double[BLOCK] y
    double[BLOCK] near
    double[BLOCK] violation
    int[BLOCK] bin


cdef inline double in_front(double near, double x, double y, double tolerance) noexcept nogil:
    """Return 1 for a point well in front of what a scan saw there, falling to 0 within the tolerance [m]."""
    return min(max((near - length_of(x, y) - tolerance) * (1.0 / tolerance), 0.0), 1.0)


cdef inline double violation(const double[::1] near, double x, double y, double tolerance) except? -1.0 nogil:
    """Return how far a point is in front of a profile."""
    return in_front(near[bin_of(x, y, near.shape[0])], x, y, tolerance)


cdef inline void write_bins(PlacedPoints *seen, Py_ssize_t bins) noexcept nogil:
    """Write which of `bins` each point lies in: near an edge by the exact bearing."""
    cdef Py_ssize_t size = seen.size, k
    for k in range(size):
        seen.bin[k] = rough_bin(seen.x[k], seen.y[k], bins)
    for k in range(size):
        if seen.bin[k] < 0:
            seen.bin[k] = exact_bin(seen.x[k], seen.y[k], bins)


cdef inline int write_violations(PlacedPoints *seen, const double[::1] near, double tolerance,
                                 const double *inverse_noise) except -1 nogil:
    """Write how far points are in front of a profile, by a tolerance [m] that is divided by their inverse noise."""
    cdef Py_ssize_t size = seen.size, k
    write_bins(seen, near.shape[0])
    for k in range(size):
        seen.near[k] = near[seen.bin[k]]
    for k in range(size):
        seen.violation[k] = in_front(seen.near[k], seen.x[k], seen.y[k], tolerance / inverse_noise[k])
    return 0
