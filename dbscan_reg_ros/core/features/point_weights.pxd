# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, cdivision=True
"""What the weight of a point is made of.

In a refinement a point weighs its own weight times the kernel of its error, 0 where the normals of point and line
disagree (`registration/point_to_line.pyx`, `fit.pyx`, `mapping/lookup.pyx`). Its own weight is 1 on a wall, and set for
poles (`poles.pyx`) and movable objects (`mapping/dynamic_points.pyx`). In a score its leverage and its own weight replace
the equal shares of all points. The errors are divided by the noise of the point (`OrientedPoints.inverse_noise`) before.

In the alignment with the map a point is paired with lines of several key frames (`mapping/correspondences.pyx`): the
kernels of all its pairs are scaled to sum to at most 1 (`Correspondences.weigh`). Of several lidars, a pair with a key
frame of another lidar weighs less where the lidars disagree (`weighted_by_agreement`).
"""
from ..geometry.exponential cimport decaying_exp


cdef inline double kernel_factor(double scale) noexcept nogil:
    """Return the `factor` of a Gaussian kernel (Eq. 18) of this `scale` [m]."""
    return -0.5 / (scale * scale)


cdef inline double kernel(double error, double factor) noexcept nogil:
    """Return the weight of a point by its distance [m] from the line, from 0 to 1."""
    return decaying_exp(factor * error * error)


cdef inline double pole_weight(double returns, double points) noexcept nogil:
    """Return the own weight of each of the `points` around a pole.

    A return of a pole counts twice: it constrains the motion along two axes.
    """
    return min(2.0 * returns / points, 1.0)


cdef inline double movable_weight(double points, double confirmed) noexcept nogil:
    """Return the own weight of each of the `points` of a movable object, and of a pole (1 point).

    `confirmed` is the kernel of its distance from what other key frames saw there. An object is one observation: its
    points share its motion, and weigh as half a static one at most; and one point 0.03.
    """
    return max(confirmed, min(0.03, 0.5 / points))


cdef inline double leverage_weight(double x, double y, double xx, double xy, double yy) noexcept nogil:
    """Return the statistical leverage of a normal (x, y) in a regression with these means of squares, times a constant.

    Few points of a corridor have normals along it; they weigh more.
    """
    return yy * x * x - 2.0 * xy * x * y + xx * y * y
