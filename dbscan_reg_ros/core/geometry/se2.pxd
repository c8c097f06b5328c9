# SPDX-License-Identifier: Apache-2.0
"""Rigid motions of the plane, as compiled steps use them."""


cdef class SE2:
    cdef readonly double x, y, theta
    cpdef SE2 inverse(self)
