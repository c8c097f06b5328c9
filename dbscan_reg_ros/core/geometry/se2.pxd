# SPDX-License-Identifier: Apache-2.0
"""Rigid motions of the plane, as compiled steps use them."""


cdef class SE2:
    cdef readonly double x, y, theta
    cpdef SE2 inverse(self)


cdef inline SE2 motion(double x, double y, double theta):
    """Return a motion by `x` [m], `y` [m] and `theta` [rad], which is wrapped already."""
    cdef SE2 made = SE2.__new__(SE2)
    made.x, made.y, made.theta = x, y, theta
    return made
