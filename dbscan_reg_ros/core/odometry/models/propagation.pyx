# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Propagation of the covariance of pose and twist."""
import numpy as np

from libc.math cimport cos, sin, sqrt


def propagate_errors(const double[:, ::1] joint, step, double interval, prior, measurement):
    """Propagate the joint covariance of pose, pose since the key frame and twist over a `step`.

    Parameters
    ----------
    joint : (9, 9) array
        Blocks of three: errors of the pose and of the pose since the key frame [m, m, rad], each in the frame of the
        scan, and of the twist [m/s, m/s, rad/s].
    step : SE2
        Motion since the last scan, in the last scan's frame.
    interval : float [s]
        Time since the last scan; 0 where unknown.
    prior : Prior
        The predicted step.
    measurement : PoseMeasurement

    Returns
    -------
    (9, 9) array
        As `joint`, in the frame of this scan.
    """
    cdef const double[:, ::1] gain = measurement.gain, measured = measurement.covariance
    cdef const double[:, ::1] covariance = np.ascontiguousarray(prior.covariance, dtype=float), change = covariance
    cdef bint by_motion_model = prior.velocity_change is not None
    cdef double rate = 1.0 / interval if interval > 0.0 else 0.0, theta = -step.theta, c = cos(theta), s = sin(theta)
    cdef double x = -c * step.x + s * step.y, y = -s * step.x - c * step.y, fading
    cdef double[3][3] adjoint = [[c, -s, y], [s, c, -x], [0.0, 0.0, 1.0]]
    cdef double[9][18] transition
    cdef double[18][18] errors
    cdef Py_ssize_t i, j, k
    if by_motion_model:
        change = np.ascontiguousarray(prior.velocity_change, dtype=float)
    with nogil:
        for i in range(18):
            for j in range(18):
                errors[i][j] = joint[i, j] if i < 9 and j < 9 else 0.0
        for i in range(3):
            for j in range(3):
                errors[9 + i][9 + j] = change[i, j]
                errors[12 + i][12 + j] = covariance[i, j] - change[i, j]
                errors[15 + i][15 + j] = measured[i, j]
                # The effect on the error of the step. The measurement removes the error made since the key frame.
                transition[i][j] = transition[i][3 + j] = 0.0
                for k in range(3):
                    transition[i][3 + j] -= gain[i, k] * adjoint[k][j]
                transition[i][9 + j] = transition[i][12 + j] = (i == j) - gain[i, j]
                transition[i][15 + j] = gain[i, j]
                # The variance of the twist stays below that of an unknown one: old errors fade as new ones are added.
                fading = sqrt(max(1.0 - rate * rate * change[j, j], 0.0)) if by_motion_model else 0.0
                transition[i][6 + j] = interval * fading * ((i == j) - gain[i, j])
        for i in range(3):
            for j in range(18):
                transition[3 + i][j] = transition[i][j]
                transition[6 + i][j] = 0.0 if 12 <= j < 15 else rate * transition[i][j]
        for i in range(3):
            for j in range(3):
                transition[i][j] += adjoint[i][j]
                transition[3 + i][3 + j] += adjoint[i][j]
    return sandwich(transition, errors)


cdef sandwich(double[9][18] transition, double[18][18] errors):
    """Return the product T E T' of a transition and the covariance of independent errors."""
    cdef double[9][18] half
    cdef Py_ssize_t i, j, k
    product = np.zeros((9, 9))
    cdef double[:, ::1] result = product
    with nogil:
        for i in range(9):
            for j in range(18):
                half[i][j] = 0.0
                for k in range(18):
                    half[i][j] += transition[i][k] * errors[k][j]
        for i in range(9):
            for j in range(9):
                for k in range(18):
                    result[i, j] += half[i][k] * transition[j][k]
    return product
