# SPDX-License-Identifier: Apache-2.0
"""Information of matched points, as `core.registration.uncertainty`."""


def informations(residuals, parameters):
    """Return the information ``(3, 3)`` of all points, and the part of it that both scans share.

    Parameters
    ----------
    residuals : Residuals
    parameters : DecisionParameters
    """
    cdef const double[:, :] rows = residuals.rows, own = residuals.own
    cdef const double[:] weight = residuals.weight
    information, shared = np.zeros((3, 3)), np.zeros((3, 3))
    cdef double[:, ::1] total = information
    cdef Py_ssize_t k, i, j
    with nogil:
        for k in range(rows.shape[1]):
            for i in range(3):
                for j in range(3):
                    total[i, j] += weight[k] * rows[i, k] * rows[j, k]
    add_shared(rows, own, weight, 0.0, -1.0, shared)
    angle, weak, _ = degeneracy_steps.weakest_direction(shared)
    if weak < parameters.weak_prior_information and degeneracy_steps.is_corridor_like(shared, angle):
        shared[:] = 0.0
        add_shared(rows, own, weight, angle, parameters.parallel_tolerance, shared)
    return information, shared


cdef int add_shared(const double[:, :] rows, const double[:, :] own, const double[:] weight, double angle,
                    double min_component, double[:, ::1] shared) except -1 nogil:
    """Add the symmetric part of the products of the lines' Jacobian and the points' own.

    Walls whose normals have a smaller component than `min_component` along the `angle` [rad] count as parallel to it.
    """
    cdef double c = cos(angle), s = sin(angle), along, off
    cdef double[3] a
    cdef double[3] b
    cdef Py_ssize_t k, i, j
    for k in range(rows.shape[1]):
        for i in range(3):
            a[i], b[i] = rows[i, k], own[i, k]
        along = c * a[0] + s * a[1]
        if fabs(along) < min_component * hypot(a[0], a[1]):
            off = c * b[0] + s * b[1]
            a[0], a[1], b[0], b[1] = a[0] - c * along, a[1] - s * along, b[0] - c * off, b[1] - s * off
        for i in range(3):
            for j in range(3):
                shared[i, j] += 0.5 * weight[k] * (a[i] * b[j] + a[j] * b[i])
    return 0
