# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, binding=True, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Repeated ranges of a scan."""
import numpy as np

from libc.math cimport INFINITY

from .geometry.ordering cimport order_statistic


def with_repeated_end(const float[:] ranges, float range_max, Py_ssize_t fewest, double stray):
    """Return the returns of a scan if one of the farthest ranges is repeated.

    Parameters
    ----------
    ranges : (N,) float32 [m]
    range_max : float [m]
        Larger ranges are no returns.
    fewest : int
        Number of equal ranges that count as repeated.
    stray : float
        Beyond them may be this fraction of the returns.

    Returns
    -------
    (R,) float [m] or None
        The ranges of all returns in ascending order; None if no range is repeated so.
    """
    cdef double[::1] found = np.empty(ranges.shape[0])
    cdef Py_ssize_t k, first, count = 0
    with nogil:
        for k in range(ranges.shape[0]):
            if 0.0 < ranges[k] <= range_max and ranges[k] < INFINITY:
                found[count] = ranges[k]
                count += 1
        if count < fewest:
            with gil:
                return None
        first = max(count - <Py_ssize_t> (stray * count) - fewest, 0)
        order_statistic(found, count, first)
    np.asarray(found[first:count]).sort()
    for k in range(first, count - fewest + 1):
        if found[k] == found[k + fewest - 1]:
            return np.sort(found[:count])
    return None
