# SPDX-License-Identifier: Apache-2.0
"""Scores of hypotheses (section 2.3), as `core.registration.scoring`."""


cdef inline double violation(const double[::1] near, double x, double y, double tolerance) except? -1.0 nogil:
    """Return 1 for a point well in front of what a scan saw, falling to 0 within the tolerance [m]."""
    return min(max((near[bin_of(x, y, near.shape[0])] - length_of(x, y) - tolerance) * (1.0 / tolerance), 0.0), 1.0)


