# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, wraparound=False, cdivision=True
"""Order statistics, stable sorting, and choices that rounding errors do not decide (`tolerance`)."""
from libc.math cimport INFINITY, fabs
from libc.stdint cimport uint32_t, uint64_t
from libc.string cimport memcpy, memset


cdef enum:
    # The inverse of `tolerance.ROUNDING`.
    INVERSE_ROUNDING = 100_000_000_000
    # More keys than this are sorted by their bytes first.
    MANY = 48


cdef inline double order_statistic(double *values, Py_ssize_t size, Py_ssize_t rank) noexcept nogil:
    """Return the value with a `rank` among `size` values, which are reordered: no larger one stays before it.

    Selection by partition. No branch depends on a value, as no processor foresees it.
    """
    cdef Py_ssize_t low = 0, high = size, end, k
    cdef double pivot, value
    while True:
        pivot = middle_of(values[low], values[(low + high) // 2], values[high - 1])
        end = low
        for k in range(low, high):
            value, values[k] = values[k], values[end]
            values[end] = value
            end += value < pivot
        if rank < end:
            high = end
            continue
        low = end
        for k in range(low, high):
            value, values[k] = values[k], values[end]
            values[end] = value
            end += value <= pivot
        if rank < end:
            return pivot
        low = end


cdef inline double middle_of(double a, double b, double c) noexcept nogil:
    """Return the second largest of three values."""
    return max(min(a, b), min(max(a, b), c))


cdef inline int sort_stably(const double[::1] keys, Py_ssize_t[::1] order, Py_ssize_t[::1] scratch) except -1 nogil:
    """Write the stable ascending order of the `keys` to `order`.

    Where there are many, they are sorted by the bytes of their upper halves first (radix sort), so that the insertion
    sort has only neighbours left to exchange.
    """
    cdef Py_ssize_t size = keys.shape[0], k, at, moved
    if not (order.shape[0] >= size and scratch.shape[0] >= size):
        raise IndexError('too little room for an order')
    if size == 0:
        return 0
    if size > MANY:
        sort_by_bytes(&keys[0], size, &order[0], &scratch[0])
    else:
        for k in range(size):
            order[k] = k
    for k in range(1, size):
        at, moved = k, order[k]
        while at > 0 and keys[order[at - 1]] > keys[moved]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = moved
    return 0


cdef inline void sort_by_bytes(const double *keys, Py_ssize_t size, Py_ssize_t *order, Py_ssize_t *scratch) noexcept nogil:
    """Write the stable order of the upper halves of the bits of numbers, from the least byte to the greatest."""
    cdef Py_ssize_t[4][256] start
    cdef Py_ssize_t k, at, byte, count, total
    cdef uint32_t bits
    memset(start, 0, sizeof(start))
    for k in range(size):
        bits = upper_bits(keys[k])
        for byte in range(4):
            start[byte][bits >> 8 * byte & 255] += 1
    for byte in range(4):
        total = 0
        for k in range(256):
            count, start[byte][k] = start[byte][k], total
            total += count
    for byte in range(4):
        for k in range(size):
            at = order[k] if byte else k
            bits = upper_bits(keys[at]) >> 8 * byte & 255
            scratch[start[byte][bits]] = at
            start[byte][bits] += 1
        order, scratch = scratch, order


cdef inline uint32_t upper_bits(double value) noexcept nogil:
    """Return the upper half of the bits of a number, changed so that they are in the order of the numbers."""
    cdef uint64_t bits
    # Both zeros are one number.
    value += 0.0
    memcpy(&bits, &value, sizeof(bits))
    return <uint32_t> ((~bits if bits >> 63 else bits | <uint64_t> 1 << 63) >> 32)


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
