# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, wraparound=False, cdivision=True
"""Order statistics, stable sorting, and choices that rounding errors do not decide (`tolerance`)."""
from libc.math cimport INFINITY, fabs


cdef enum:
    # The inverse of `tolerance.ROUNDING`.
    INVERSE_ROUNDING = 100_000_000_000


cdef inline double order_statistic(double[::1] values, Py_ssize_t size, Py_ssize_t rank) except? -1.0 nogil:
    """Return the value with a `rank` among the first `size` values, which are reordered (Hoare's selection)."""
    cdef Py_ssize_t low = 0, high = size - 1, i, j
    cdef double pivot
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    return values[rank]


cdef inline int sort_stably(const double[::1] keys, Py_ssize_t[::1] order, Py_ssize_t[::1] scratch) except -1 nogil:
    """Write the stable ascending order of the `keys` to `order` (merge sort, bottom up)."""
    cdef Py_ssize_t size = keys.shape[0], width = 1, k, i, j, middle, end, start
    for k in range(size):
        order[k] = k
    while width < size:
        start = 0
        while start < size:
            middle, end = min(start + width, size), min(start + 2 * width, size)
            i, j = start, middle
            if middle == end or keys[order[middle - 1]] <= keys[order[middle]]:
                for k in range(start, end):
                    scratch[k] = order[k]
                start += 2 * width
                continue
            for k in range(start, end):
                if i < middle and (j >= end or keys[order[i]] <= keys[order[j]]):
                    scratch[k] = order[i]
                    i += 1
                else:
                    scratch[k] = order[j]
                    j += 1
            start += 2 * width
        for k in range(size):
            order[k] = scratch[k]
        width *= 2
    return 0


cdef inline bint is_larger(double value, double other) noexcept nogil:
    """Whether more than rounding makes a value larger than another."""
    return value - other > max(fabs(value), fabs(other)) / <double> INVERSE_ROUNDING


cdef inline int sort_up_to_rounding(const double[::1] keys, Py_ssize_t[::1] order, Py_ssize_t[::1] scratch) except -1 nogil:
    """Write the ascending order of the keys, of equal ones by index, as `ties.order_up_to_rounding`."""
    cdef Py_ssize_t size = keys.shape[0], k, at, moved
    sort_stably(keys, order, scratch)
    if size:
        scratch[0] = 0
    for k in range(1, size):
        # Where the keys that equal this one begin.
        scratch[k] = k if is_larger(keys[order[k]], keys[order[k - 1]]) else scratch[k - 1]
    for k in range(1, size):
        at, moved = k, order[k]
        while at > scratch[k] and order[at - 1] > moved:
            order[at] = order[at - 1]
            at -= 1
        order[at] = moved
    return 0


cdef inline Py_ssize_t first_largest(const double[::1] values) except -1 nogil:
    """Return the index of the first value that only rounding makes less than the largest, as `ties.first_largest`."""
    cdef Py_ssize_t k
    cdef double largest = -INFINITY
    for k in range(values.shape[0]):
        largest = max(largest, values[k])
    for k in range(values.shape[0]):
        if values[k] >= largest - fabs(largest) / <double> INVERSE_ROUNDING:
            return k
    return 0


cdef inline Py_ssize_t bisect_right(const double[::1] values, Py_ssize_t size, double value) except -1 nogil:
    """Return the number of ascending values up to `value`."""
    cdef Py_ssize_t low = 0, high = size, middle
    while low < high:
        middle = (low + high) // 2
        if values[middle] <= value:
            low = middle + 1
        else:
            high = middle
    return low
