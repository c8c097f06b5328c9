# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Covariance and observability of a registered motion, estimated from its residuals."""
import numpy as np

from ..geometry import tolerance
from ..geometry.se2 import turned
from . import residuals as residual_records
from .residuals import Observability

from libc.math cimport cos, fabs, sin, sqrt

from ..features.oriented_points cimport OrientedPoints
from ..geometry.exponential cimport decaying_exp
from ..geometry.plane cimport length_of
from ..geometry.symmetric cimport Weakest, read_weakest, write_inverse
from .point_to_line cimport product_imag

cdef double SIGMAS = tolerance.SIGMAS, TINY = tolerance.TINY
# Number of neighbouring points whose normals are correlated.
cdef double DEPENDENT = 5.0
cdef double CORRIDOR_RATIO = residual_records.CORRIDOR_RATIO


def uncertainty(candidate, found, OrientedPoints points, double noise, p):
    """Return the covariance ``(3, 3)`` [m, m, rad] of a motion in the current sensor's frame, and its `Observability`.

    Parameters
    ----------
    candidate : (3,) array [m, m, rad]
    found : Fit
        Of the candidate, for the `points`.
    points : OrientedPoints
        Of the current scan.
    noise : float [m]
        Standard deviation of a range. It adds to the spread of the errors.
    p : Parameters
    """
    cdef const double[:, ::1] error = found.error
    cdef const unsigned char[:, ::1] alike = found.alike
    cdef const double complex[:, ::1] normal = found.normals, rotated = found.rotated_points
    cdef double theta = candidate[2], c = cos(theta), s = sin(theta), x, y, nx, ny, scale = p.refinement.score_scale
    cdef double factor = -0.5 / (scale * scale)
    cdef double[:, ::1] rows = np.empty((3, points.size)), own = np.empty((3, points.size))
    cdef double[::1] weight = np.empty(points.size)
    cdef Py_ssize_t k
    with nogil:
        for k in range(points.size):
            x, y = rotated[0, k].real, rotated[0, k].imag
            rows[0, k], rows[1, k] = normal[0, k].real, -normal[0, k].imag
            rows[2, k] = -product_imag(normal[0, k], rotated[0, k])
            nx, ny = points.normals_view[k].real * points.inverse_noise_view[k], points.normals_view[k].imag * points.inverse_noise_view[k]
            own[0, k], own[1, k] = c * nx - s * ny, s * nx + c * ny
            own[2, k] = x * own[1, k] - y * own[0, k]
            # Gaussian kernel (Eq. 18), 0 where the normals disagree.
            weight[k] = (decaying_exp(factor * error[0, k] * error[0, k]) * points.weights_view[k] if alike[0, k]
                         else 0.0)
    return covariance_of(error[0], weight, rows, own, noise, p.decision, theta, False, False)


def match_covariance(residuals, parameters, double theta, bint latest_degenerate=False,
                     bint rotation_unobservable=False):
    """Return the covariance ``(3, 3)`` [m, m, rad] of a match in the frame of the scan, and its `Observability`.

    Parameters
    ----------
    residuals : Residuals
    parameters : DecisionParameters
    theta : float [rad]
        Rotation of the scan in the frame of the residuals.
    latest_degenerate : bool
        Whether the translation to the latest key frame is degenerate: older ones have to constrain it beyond chance.
    rotation_unobservable : bool
        Whether the rotation is unobservable, whatever the residuals say.
    """
    return covariance_of(residuals.error, residuals.weight, residuals.rows, residuals.own, residuals.noise, parameters,
                         theta, latest_degenerate, rotation_unobservable)


def shared_information(const double[:, :] rows, const double[::1] weight, const double[:, :] own):
    """Return the information ``(3, 3)`` of points with unit standard deviation, as far as it is shared by both scans.

    Each product combines the normal of the line with the normal of the point itself. Independent noise of the two
    normals cancels, so that a smooth wall does not seem to constrain the motion along the wall. The result may be
    indefinite if there is only noise.

    Parameters
    ----------
    rows, own : (3, P) arrays
        Jacobian of the errors computed with the normals of the lines, and computed with those of the points themselves.
    weight : (P,) array
        From 0 to 1.
    """
    cdef double[3] motion = [0.0, 0.0, 0.0]
    shared = np.zeros((3, 3))
    add_shared(rows, own, weight, motion, 0.0, shared)
    return shared


def degenerate_translation(double angle, const double[:, ::1] shared, parameters):
    """Return ``(3,)`` [m, m, rad]: a translation of 1 m along `angle` [rad], and the rotation coupled with it.

    A direction may be degenerate only together with a rotation, as along the wall of a circular room. The rotation
    follows from the `shared` information ``(3, 3)``.
    """
    cdef double[3] along
    write_degenerate(angle, shared, parameters.min_information, along)
    return np.array((along[0], along[1], along[2]))


def degenerate_rotation(const double[:, ::1] information, const double[:, ::1] shared, parameters):
    """Return ``(3,)`` [m, m, rad]: a rotation of 1 rad, and the translation coupled with it, by two ``(3, 3)``."""
    cdef double[3] turn
    constrain_rotation(shared, information, parameters.min_information, turn)
    return np.array((turn[1], turn[2], 1.0))


cdef covariance_of(const double[::1] error, const double[::1] weight, const double[:, ::1] rows,
                   const double[:, ::1] own, double noise, parameters, double theta, bint latest_degenerate,
                   bint rotation_unobservable):
    """Return what `match_covariance` returns, from the parts of the residuals."""
    cdef double count = 0.0, squared = 0.0, chance, excess, few = parameters.min_information
    cdef double[:, :, ::1] matrices = np.zeros((2, 3, 3))
    cdef double[:, ::1] information = matrices[0], shared = matrices[1]
    cdef double[3] turn
    cdef double[3] turn_noise
    cdef Py_ssize_t k
    cdef Weakest weakest, seeming
    for k in range(weight.shape[0]):
        count += weight[k]
        squared += error[k] * error[k] * weight[k]
    add_informations(rows, own, weight, parameters, information, shared)
    # Where only noise constrains the rotation, as much of it as agrees by chance is subtracted.
    read_weakest(shared, &weakest)
    constrain_rotation(shared, information, few, turn)
    constrain_rotation(information, information, few, turn_noise)
    chance = SIGMAS * sqrt(DEPENDENT / max(count, 1.0))
    excess = max(turn[0] - chance * max(turn_noise[0] - turn[0], 0.0), 0.0)
    if latest_degenerate:
        read_weakest(information, &seeming)
        weakest.weak = max(weakest.weak - chance * (seeming.weak - weakest.weak), 0.0)
    if rotation_unobservable:
        excess = 0.0
    covariance = calibrated_covariance(information, shared, squared / max(count, TINY) + noise * noise, weakest,
                                       excess < few, turn, parameters)
    return turned(covariance, -theta), Observability(weakest.angle, weakest.weak, excess)


cdef int constrain_rotation(const double[:, ::1] shared, const double[:, ::1] information, double few,
                            double *turn) except -1 nogil:
    """Write the information about the rotation, and the translation along x and y [m/rad] that compensates it best."""
    cdef double xx = information[0, 0] + few, yy = information[1, 1] + few, xy = information[0, 1]
    cdef double x = shared[2, 0], y = shared[2, 1], determinant = xx * yy - xy * xy
    turn[1], turn[2] = (xy * y - yy * x) / determinant, (xy * x - xx * y) / determinant
    turn[0] = shared[2, 2] + turn[1] * x + turn[2] * y
    return 0


cdef calibrated_covariance(const double[:, ::1] information, const double[:, ::1] shared, double variance,
                           Weakest weakest, bint no_rotation, double *turn, parameters):
    """Return the covariance ``(3, 3)`` of a motion from the information of its points, and `variance` [m^2] of one.

    Few points along a direction are less certain than their number says, as their errors are not independent. A
    direction that fewer than `decision.min_information` points constrain gets the variance of an unknown motion.
    """
    cdef const double[::1] prior = residual_records.PRIOR_INFORMATION
    cdef double few = parameters.min_information, extra = 1.0 / prior[0]
    cdef double[:, ::1] posterior = np.empty((3, 3)), result = np.empty((3, 3))
    cdef double[3] along
    cdef Py_ssize_t i, j
    variance *= parameters.covariance_scale
    for i in range(3):
        for j in range(3):
            posterior[i, j] = information[i, j] / variance
        posterior[i, i] += prior[i]
    write_inverse(posterior, result)
    write_degenerate(weakest.angle, shared, few, along)
    if weakest.weak >= few:
        extra = min(variance * parameters.few_points_scale / (weakest.weak * weakest.weak), extra)
    # The translation that goes with a rotation of 1 rad.
    turn[0], turn[1], turn[2] = turn[1], turn[2], 1.0
    for i in range(3):
        for j in range(3):
            result[i, j] += extra * along[i] * along[j]
            if no_rotation:
                result[i, j] += turn[i] * turn[j] / prior[2]
    return np.asarray(result)


cdef double translational(const double[:, ::1] information, double angle) noexcept nogil:
    """Return the information about the translation along `angle` [rad] for a known rotation."""
    cdef double c = cos(angle), s = sin(angle)
    return c * c * information[0, 0] + 2.0 * c * s * information[0, 1] + s * s * information[1, 1]


cdef int write_degenerate(double angle, const double[:, ::1] shared, double few, double *along) except -1 nogil:
    """Write a translation of 1 m along `angle` [rad], and the rotation [rad] that goes with it."""
    cdef double c = cos(angle), s = sin(angle), x = shared[0, 2], y = shared[1, 2], rotation = shared[2, 2]
    along[0], along[1] = c, s
    along[2] = -(x * c + y * s) / rotation if min(translational(shared, angle), rotation) > few else 0.0
    return 0


cdef int write_parallel(double angle, const double[:, ::1] information, double few, double *motion) except -1:
    """Write the motion along `angle` [rad] that walls of a corridor are parallel to: a translation of 1 m or an arc."""
    cdef double straight = translational(information, angle), bend
    write_degenerate(angle, information, few, motion)
    bend = information[0, 2] * motion[0] + information[1, 2] * motion[1]
    if straight + motion[2] * bend >= CORRIDOR_RATIO * straight:
        motion[2] = 0.0
    return 0


cdef int add_informations(const double[:, ::1] rows, const double[:, ::1] own, const double[::1] weight, parameters,
                          double[:, ::1] information, double[:, ::1] shared) except -1:
    """Add the information ``(3, 3)`` of all points, and the part of it that both scans share."""
    cdef Py_ssize_t k, i, j
    cdef double[3] motion
    cdef Weakest weakest
    motion[0] = motion[1] = motion[2] = 0.0
    with nogil:
        for k in range(rows.shape[1]):
            for i in range(3):
                for j in range(3):
                    information[i, j] += weight[k] * rows[i, k] * rows[j, k]
        add_shared(rows, own, weight, motion, 0.0, shared)
        read_weakest(shared, &weakest)
    if weakest.weak < parameters.weak_prior_information and is_corridor_like(shared, weakest.angle):
        write_parallel(weakest.angle, shared, parameters.min_information, motion)
        shared[:, :] = 0.0
        add_shared(rows, own, weight, motion, parameters.parallel_tolerance, shared)
    return 0


cdef bint is_corridor_like(const double[:, ::1] information, double angle) except -1:
    """Whether few points face along the direction `angle` [rad], by their information."""
    return (translational(information, angle)
            < CORRIDOR_RATIO * (information[0, 0] + information[1, 1]))


cdef int add_shared(const double[:, :] rows, const double[:, :] own, const double[::1] weight,
                    const double *motion, double min_component, double[:, ::1] shared) except -1 nogil:
    """Add the symmetric part of the products of the lines' Jacobian and the points' own.

    Walls that the `motion` moves by less than `min_component` [m] across themselves count as parallel to it.
    """
    cdef double across, off
    cdef double[3] a
    cdef double[3] b
    cdef Py_ssize_t k, i, j
    for k in range(rows.shape[1]):
        for i in range(3):
            a[i], b[i] = rows[i, k], own[i, k]
        across = motion[0] * a[0] + motion[1] * a[1] + motion[2] * a[2]
        if fabs(across) < min_component * length_of(a[0], a[1]):
            off = motion[0] * b[0] + motion[1] * b[1] + motion[2] * b[2]
            a[0], a[1] = a[0] - motion[0] * across, a[1] - motion[1] * across
            b[0], b[1] = b[0] - motion[0] * off, b[1] - motion[1] * off
        for i in range(3):
            for j in range(3):
                shared[i, j] += 0.5 * weight[k] * (a[i] * b[j] + a[j] * b[i])
    return 0
