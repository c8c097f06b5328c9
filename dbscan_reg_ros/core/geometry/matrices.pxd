# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, wraparound=False, cdivision=True
"""Products of small matrices, stored by rows; their sums are in a fixed order."""


cdef inline void multiply(double[3][3] left, double[3][3] right, double[3][3] product) noexcept nogil:
    """Multiply two ``(3, 3)`` matrices."""
    cdef Py_ssize_t i, j, k
    for i in range(3):
        for j in range(3):
            product[i][j] = 0.0
            for k in range(3):
                product[i][j] += left[i][k] * right[k][j]


cdef inline void sandwich(const double *transition, Py_ssize_t rows, const double *errors, Py_ssize_t size,
                          double *result) noexcept nogil:
    """Write T E T' of a transition ``(rows, size)`` and a covariance ``(size, size)``, at most 9 and 18."""
    cdef double[9][18] half
    cdef Py_ssize_t i, j, k
    for i in range(rows):
        for j in range(size):
            half[i][j] = 0.0
        for k in range(size):
            for j in range(size):
                half[i][j] += transition[i * size + k] * errors[k * size + j]
    for i in range(rows):
        for j in range(rows):
            result[i * rows + j] = 0.0
            for k in range(size):
                result[i * rows + j] += half[i][k] * transition[j * size + k]
