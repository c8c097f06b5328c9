# SPDX-License-Identifier: Apache-2.0
"""Vectors of the plane as complex numbers; lines by total least squares."""


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
    """Subtract whole periods from an angle [rad], as `rotation.wrap_period`."""
    return angle - period * rint(angle * (1.0 / period))


cdef inline double wrap(double angle) noexcept nogil:
    """Wrap an angle [rad] to [-pi, pi)."""
    cdef double rest = fmod(angle + M_PI, 2.0 * M_PI)
    return (rest + 2.0 * M_PI if rest < 0.0 else rest) - M_PI


cdef struct Line:
    # Centre [m], unit direction with a component along x that is not negative, spread and residual [m^2].
    double x, y, c, s, spread, residual


cdef inline Line fit_line(double x, double y, double xx, double xy, double yy, double count) noexcept nogil:
    """Fit a total least squares line to points with these summed moments (Eq. 7), as `line_fit.fit_lines`."""
    cdef Line line
    cdef double half, apart, root
    line.x, line.y = x / count, y / count
    xx, xy, yy = xx / count - line.x * line.x, xy / count - line.x * line.y, yy / count - line.y * line.y
    half, apart = 0.5 * (xx + yy), 0.5 * (xx - yy)
    root = length_of(apart, xy)
    # The direction is half the angle of (apart, xy); of both its components the larger is computed first.
    line.c, line.s = 1.0, 0.0
    if root > 0.0 and apart >= 0.0:
        line.c = sqrt(0.5 * (1.0 + apart / root))
        line.s = 0.5 * xy / (root * line.c)
    elif root > 0.0:
        line.s = copysign(sqrt(0.5 * (1.0 - apart / root)), xy)
        line.c = 0.5 * xy / (root * line.s)
    line.spread, line.residual = half + root, max(half - root, 0.0)
    return line


cdef inline Line fit_range(const double[:, ::1] moments, Py_ssize_t first, Py_ssize_t end) noexcept nogil:
    """Fit a line to the points from `first` to before `end`, from the `summed_moments` of a scan; indices are valid."""
    return fit_line(moments[0, end] - moments[0, first], moments[1, end] - moments[1, first],
                    moments[2, end] - moments[2, first], moments[3, end] - moments[3, first],
                    moments[4, end] - moments[4, first], <double> (end - first))


cdef struct Factors:
    # Of a symmetric matrix (3, 3) as L D L': the diagonal of D, and L below its own by rows.
    double a, b, c, p, q, r


cdef inline Factors factors(double xx, double xy, double xt, double yy, double yt, double tt) noexcept nogil:
    """Factorise the symmetric matrix with this upper triangle, as `symmetric_matrix`."""
    cdef double p = xy / xx, q = xt / xx, b = yy - p * xy, rest = yt - p * xt, r = rest / b
    return Factors(xx, b, tt - q * xt - r * rest, p, q, r)


cdef double squared_distance(const double[:, ::1] covariance, double *error) except? -1.0 nogil:
    """Return the squared Mahalanobis distance of an error from 0, as `symmetric_matrix.mahalanobis`."""
    cdef Factors f = factors(covariance[0, 0], covariance[0, 1], covariance[0, 2], covariance[1, 1], covariance[1, 2],
                             covariance[2, 2])
    cdef double y = error[1] - f.p * error[0], t = error[2] - f.q * error[0] - f.r * y
    return error[0] * error[0] / f.a + y * y / f.b + t * t / f.c


cdef int write_inverse(const double[:, ::1] matrix, double[:, ::1] result) except -1 nogil:
    """Write the inverse of a symmetric matrix ``(3, 3)``, as `symmetric_matrix.inverse`."""
    cdef Factors f = factors(matrix[0, 0], matrix[0, 1], matrix[0, 2], matrix[1, 1], matrix[1, 2], matrix[2, 2])
    cdef double tt = 1.0 / f.c, yt = -f.r * tt, yy = 1.0 / f.b - f.r * yt, xt = -f.p * yt - f.q * tt
    cdef double xy = -f.p * yy - f.q * yt
    result[0, 0] = 1.0 / f.a - f.p * xy - f.q * xt
    result[0, 1] = result[1, 0] = xy
    result[0, 2] = result[2, 0] = xt
    result[1, 1] = yy
    result[1, 2] = result[2, 1] = yt
    result[2, 2] = tt
    return 0


cdef struct Weakest:
    # Direction [rad] in which the translation is constrained least, and the information along it and across it.
    double angle, weak, strong


cdef Weakest weakest_direction(double xx, double xy, double x, double yy, double y, double rotation) noexcept nogil:
    """Find the direction in which a match constrains the translation least, for an unknown rotation."""
    cdef double half, root
    rotation = max(rotation, TINY)
    xx, xy, yy = xx - x * x / rotation, xy - x * y / rotation, yy - y * y / rotation
    half, root = 0.5 * (xx + yy), length_of(0.5 * (xx - yy), xy)
    return Weakest(0.5 * atan2(2.0 * xy, xx - yy) + 0.5 * M_PI, max(half - root, 0.0), half + root)


cdef inline int read_weakest(const double[:, ::1] information, Weakest *found) except -1 nogil:
    """Find the `weakest_direction` of an information matrix, or of the normal equations."""
    found[0] = weakest_direction(information[0, 0], information[0, 1], information[0, 2], information[1, 1],
                                 information[1, 2], information[2, 2])
    return 0
