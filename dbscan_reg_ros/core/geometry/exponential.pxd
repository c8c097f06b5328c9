# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, cdivision=True
"""The exponential of Gaussian kernels: arithmetic alone, so that it is the same everywhere and loops become vectors."""


cdef inline double decaying_exp(double x) noexcept nogil:
    """Return ``exp(x)`` of a number that is not positive, to 2e-12 of it; below -64 that of -64.

    The power series of ``exp(x / 256)`` to the tenth order, squared eight times.
    """
    cdef double r = (x if x > -64.0 else -64.0) * (1.0 / 256.0)
    cdef double y = 1.0 + r * (1.0 + r * (1.0 / 2.0 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (
        1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0 + r * (1.0 / 40320.0 + r * (
            1.0 / 362880.0 + r * (1.0 / 3628800.0))))))))))
    y *= y
    y *= y
    y *= y
    y *= y
    y *= y
    y *= y
    y *= y
    return y * y
