# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, wraparound=False, cdivision=True
"""Vectors of the plane as complex numbers; lines by total least squares; bins of bearings."""
from libc.math cimport M_PI, atan2, copysign, fabs, fmod, rint, sqrt


cdef inline double complex vector(double x, double y) noexcept nogil:
    """Return a vector; ``x + 1j * y`` would lose the sign of zeros."""
    cdef double complex a
    a.real, a.imag = x, y
    return a


cdef inline double cross(double complex a, double complex b) noexcept nogil:
    """Return the cross product of two vectors."""
    return a.real * b.imag - a.imag * b.real


cdef inline double dot(double complex a, double complex b) noexcept nogil:
    """Return the scalar product of two vectors."""
    return a.real * b.real + a.imag * b.imag


cdef inline double length_of(double x, double y) noexcept nogil:
    """Return the length of a vector; the square root, as no point is so far that its square overflows."""
    return sqrt(x * x + y * y)


cdef inline double modulus(double complex a) noexcept nogil:
    """Return the length of a vector."""
    return length_of(a.real, a.imag)


cdef inline double distance(double complex a, double complex b) noexcept nogil:
    """Return the distance of two points."""
    return length_of(a.real - b.real, a.imag - b.imag)


cdef inline double complex rotated(double complex a, double complex b) noexcept nogil:
    """Return the product of two complex numbers."""
    return (a.real * b.real - a.imag * b.imag) + 1j * (a.real * b.imag + a.imag * b.real)


cdef inline double wrapped(double angle, double period) noexcept nogil:
    """Subtract whole periods from an angle [rad], as `se2.wrap_period`."""
    return angle - period * rint(angle * (1.0 / period))


cdef inline double wrap(double angle) noexcept nogil:
    """Wrap an angle [rad] to [-pi, pi)."""
    cdef double rest = fmod(angle + M_PI, 2.0 * M_PI)
    return (rest + 2.0 * M_PI if rest < 0.0 else rest) - M_PI


cdef struct Line:
    # Centre [m], unit direction with a component along x that is not negative, spread and residual [m^2].
    double x, y, c, s, spread, residual


cdef struct Moments:
    # Sums of x, y [m], xx, xy, yy [m^2] over points.
    double x, y, xx, xy, yy


cdef inline Moments difference(const Moments *all, const Moments *part) noexcept nogil:
    """Return the sums over the points that are not in a part."""
    return Moments(all.x - part.x, all.y - part.y, all.xx - part.xx, all.xy - part.xy, all.yy - part.yy)


cdef inline Line fit_line(Moments sums, double count) noexcept nogil:
    """Fit a total least squares line to points with these summed moments (Eq. 7), without branches."""
    cdef Line line
    cdef double xx, xy, yy, half, apart, root, larger, smaller
    line.x, line.y = sums.x / count, sums.y / count
    xx, xy = sums.xx / count - line.x * line.x, sums.xy / count - line.x * line.y
    yy = sums.yy / count - line.y * line.y
    half, apart = 0.5 * (xx + yy), 0.5 * (xx - yy)
    root = length_of(apart, xy)
    # The direction is half the angle of (apart, xy); of both its components the larger is computed first.
    larger = sqrt(0.5 * (1.0 + fabs(apart) / root))
    smaller = 0.5 * xy / (root * larger)
    line.c = larger if apart >= 0.0 else fabs(smaller)
    line.s = smaller if apart >= 0.0 else copysign(larger, xy)
    line.c, line.s = line.c if root > 0.0 else 1.0, line.s if root > 0.0 else 0.0
    line.spread, line.residual = half + root, max(half - root, 0.0)
    return line


cdef inline double rough_arctangent(double x, double y) noexcept nogil:
    """Return the bearing of a point [rad] to 1e-5, 0 at the sensor; not a number where the point is infinite.

    Abramowitz and Stegun, "Handbook of Mathematical Functions", 4.4.47.
    """
    cdef double across = fabs(x), up = fabs(y), ratio = min(across, up) / max(across, up, 1e-300), s = ratio * ratio
    cdef double angle = ratio * (0.9998660 + s * (-0.3302995 + s * (0.1801410 + s * (-0.0851330 + s * 0.0208351))))
    # Without branches, which no processor foresees.
    angle = (0.5 * M_PI if up > across else 0.0) + (-1.0 if up > across else 1.0) * angle
    angle = (M_PI if x < 0.0 else 0.0) + (-1.0 if x < 0.0 else 1.0) * angle
    return (-1.0 if y < 0.0 else 1.0) * angle


cdef inline int rough_bin(double x, double y, Py_ssize_t size) noexcept nogil:
    """Return which of `size` bins of the full circle a point lies in, or -1 near an edge."""
    cdef double place = (rough_arctangent(x, y) + M_PI) * (size / (2.0 * M_PI)), rest = place - <double> <int> place
    return <int> (place if min(rest, 1.0 - rest) > 1e-5 * size else -1.0)


cdef inline Py_ssize_t exact_bin(double x, double y, Py_ssize_t size) noexcept nogil:
    """Return which of `size` bins of the full circle a point lies in."""
    return min(<Py_ssize_t> ((atan2(y, x) + M_PI) * (size / (2.0 * M_PI))), size - 1)


cdef inline Py_ssize_t bin_of(double x, double y, Py_ssize_t size) noexcept nogil:
    """Return which of `size` bins of the full circle a point lies in: near an edge by the exact bearing."""
    cdef int number = rough_bin(x, y, size)
    return number if number >= 0 else exact_bin(x, y, size)
