# SPDX-License-Identifier: Apache-2.0
"""Scores of hypotheses (section 2.3), as `core.registration.scoring`."""


cdef inline double violation(const double[::1] near, double x, double y, double tolerance) except? -1.0 nogil:
    """Return 1 for a point well in front of what a scan saw, falling to 0 within the tolerance [m]."""
    cdef Py_ssize_t size = near.shape[0]
    cdef Py_ssize_t number = min(<Py_ssize_t> ((atan2(y, x) + M_PI) * (size / (2.0 * M_PI))), size - 1)
    return min(max((near[number] - hypot(x, y) - tolerance) * (1.0 / tolerance), 0.0), 1.0)


def score(fits, reference, current, double scale, parameters):
    """Score each hypothesis by the points of the current scan.

    Parameters
    ----------
    fits : Fit
        Of the current scan's `sampled_points` to the reference.
    reference, current : Features
    scale : float [m]
        Kernel.
    parameters : DensityParameters

    Returns
    -------
    score : (H,) array
        Weighted fraction of the points on the reference's surfaces less the fraction in its free space; at most 1.
    overlap : (H,) array
        Unweighted fraction of the points on the reference's surfaces.
    """
    cdef const double[:, ::1] error = fits.error
    cdef const unsigned char[:, ::1] alike = fits.alike
    cdef const double complex[:, ::1] place = fits.places
    cdef const double[::1] near = reference.free_space.near, share = current.leverage
    cdef Py_ssize_t size = error.shape[1], h, k
    cdef const double[::1] inverse_noise = given_or_ones(current.sampled_points.inverse_noise, size)
    cdef double tolerance = parameters.violation_tolerance
    cdef double factor = -0.5 / (scale * scale), against = parameters.violation_weight, weight, lost
    values, overlaps = np.zeros(error.shape[0]), np.zeros(error.shape[0])
    cdef double[::1] value = values, overlap = overlaps
    with nogil:
        for h in range(error.shape[0]):
            for k in range(size):
                # Gaussian kernel (Eq. 18), 0 where the normals disagree.
                weight = exp(factor * error[h, k] * error[h, k]) if alike[h, k] else 0.0
                lost = (violation(near, place[h, k].real, place[h, k].imag, tolerance / inverse_noise[k])
                        * (1.0 - weight))
                value[h] += (weight - against * lost) * share[k]
                overlap[h] += weight
            overlap[h] /= <double> max(size, 1)
    return values, overlaps


def reverse_violation(const double[:, :] candidates, reference, current, parameters):
    """Return the weighted fraction ``(H,)`` of the reference's points in free space of the current scan."""
    points = reference.sampled_points
    cdef const double complex[::1] own = points.points
    cdef const double[::1] near = current.free_space.near, share = reference.leverage
    cdef Py_ssize_t size = own.shape[0], h, k
    cdef const double[::1] inverse_noise = given_or_ones(points.inverse_noise, size)
    cdef double tolerance = parameters.violation_tolerance
    fractions = np.zeros(candidates.shape[0])
    cdef double[::1] fraction = fractions
    cdef double c, s, x, y
    with nogil:
        for h in range(candidates.shape[0]):
            c, s = cos(candidates[h, 2]), sin(candidates[h, 2])
            for k in range(size):
                x, y = own[k].real - candidates[h, 0], own[k].imag - candidates[h, 1]
                fraction[h] += violation(near, c * x + s * y, c * y - s * x, tolerance / inverse_noise[k]) * share[k]
    return fractions
