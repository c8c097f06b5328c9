# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, cdivision=True
"""Velocities of the first sensor in its own frame."""
from ...geometry.plane cimport length_of, wrap
from ...geometry.se2 cimport SE2, motion


cdef struct Twist:
    # Velocity [m/s, m/s] and turn rate [rad/s]; or their variances.
    double x, y, turn


cdef inline SE2 integrated(Twist twist, double time):
    """Return the motion of a constant `twist` in a `time` [s], to first order."""
    return motion(twist.x * time, twist.y * time, wrap(twist.turn * time))


cdef inline Twist limited(Twist twist, double max_speed, double max_turn_rate) noexcept nogil:
    """Return a twist clipped to the limits of speed [m/s] and turn rate [rad/s]."""
    cdef double speed = length_of(twist.x, twist.y), ratio = max_speed / speed if speed > max_speed else 1.0
    return Twist(twist.x * ratio, twist.y * ratio, min(max(twist.turn, -max_turn_rate), max_turn_rate))


cdef inline Twist twist_variance(Twist variance, Twist last, Twist twist, double time, double time_sigma) noexcept nogil:
    """Return the variances by which the velocity at the stamp may differ from the mean since the scan before.

    It may have changed by half as much as the mean did, and has rotated by half the rotation. An error of the time is
    one of the velocity. A quarter of the last `variance` remains, as the scan was deskewed with the `last` twist.

    Parameters
    ----------
    variance : Twist
        The result for the scan before.
    last, twist : Twist
        Mean velocities up to the scan before, and since then.
    time, time_sigma : float [s]
        Time since the scan before, and its standard deviation.
    """
    cdef double turned = twist.turn * time, relative = time_sigma / time
    return Twist(squared(twist.x - last.x, turned * twist.y, relative * twist.x) + 0.25 * variance.x,
                 squared(twist.y - last.y, turned * twist.x, relative * twist.y) + 0.25 * variance.y,
                 squared(twist.turn - last.turn, 0.0, relative * twist.turn) + 0.25 * variance.turn)


cdef inline double squared(double change, double turned, double by_time) noexcept nogil:
    """Return a variance from half of a `change`, half of what a velocity `turned` by, and an error of the time."""
    return 0.25 * (change * change + turned * turned) + by_time * by_time
