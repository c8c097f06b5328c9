# SPDX-License-Identifier: Apache-2.0
"""Leverage of oriented points, as `core.features.oriented`."""


def leverage(oriented, double ridge):
    """Return weights ``(P,)`` with sum 1 that are larger for points with a rare normal direction.

    The weight is the statistical leverage of the normal in a regression with this `ridge`; large values make all points
    equal.
    """
    cdef const double complex[::1] normals = oriented.normals
    cdef Py_ssize_t size = normals.shape[0], k
    cdef const double[::1] given = given_or_ones(oriented.weights, size)
    cdef double xx = 0.0, xy = 0.0, yy = 0.0, x, y, total = 0.0
    weights = np.empty(size)
    cdef double[::1] weight = weights
    with nogil:
        for k in range(size):
            x, y = normals[k].real, normals[k].imag
            xx, xy, yy = xx + x * x, xy + x * y, yy + y * y
        xx, xy, yy = xx / max(size, 1) + ridge, xy / max(size, 1), yy / max(size, 1) + ridge
        for k in range(size):
            x, y = normals[k].real, normals[k].imag
            weight[k] = (yy * x * x - 2.0 * xy * x * y + xx * y * y) * given[k]
            total += weight[k]
        for k in range(size):
            weight[k] /= max(total, TINY)
    return weights


def high_leverage(const double complex[::1] normals):
    """Find points with a rare normal direction: those with more than twice the mean leverage.

    Parameters
    ----------
    normals : (P,) complex
        Unit normals.

    Returns
    -------
    (P,) bool
    """
    cdef Py_ssize_t size = normals.shape[0], k
    cdef double x = 0.0, y = 0.0
    cdef double complex double_angle
    flags = np.empty(size, dtype=bool)
    cdef unsigned char[::1] rare = flags
    with nogil:
        # The double angle makes a direction and its opposite equal: the leverage is 2 (1 - c r) / (1 - r^2).
        for k in range(size):
            double_angle = rotated(normals[k], normals[k])
            x, y = x + double_angle.real, y + double_angle.imag
        x, y = x / max(size, 1), y / max(size, 1)
        for k in range(size):
            double_angle = rotated(normals[k], normals[k])
            rare[k] = double_angle.real * x + double_angle.imag * y < 2.0 * (x * x + y * y) - 1.0
    return flags
