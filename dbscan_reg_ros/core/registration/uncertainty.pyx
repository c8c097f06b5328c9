# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Covariance and observability of a registered motion, estimated from its residuals."""
import numpy as np

from ..geometry import tolerance
from . import residuals as residual_records
from .residuals import Observability

cimport cython
from libc.math cimport cos, fabs, sin, sqrt
from libc.string cimport memcpy

from ..geometry.plane cimport length_of
from ..geometry.symmetric cimport (Symmetric, Weakest, inverse_of, symmetric, turn, weakest_direction, weakest_of,
                                  write_rows)

cdef double SIGMAS = tolerance.SIGMAS, TINY = tolerance.TINY
# Number of neighbouring points whose normals are correlated.
cdef double DEPENDENT = 5.0
# Largest sine of the angle between a wall and the lines that its direction is found from, in one pass after the other.
cdef double[2] NEARLY_PARALLEL = [0.5, 0.25]
cdef double CORRIDOR_RATIO = residual_records.CORRIDOR_RATIO
cdef double[3] PRIOR_INFORMATION = [*residual_records.PRIOR_INFORMATION]


def match_covariance(const double[:, ::1] table, double noise, parameters, double theta, bint latest_degenerate=False,
                     bint rotation_unobservable=False):
    """Return the covariance ``(3, 3)`` [m, m, rad] of a match in the frame of the scan, and its `Observability`.

    Parameters
    ----------
    table : (8, M) array
        Residuals of M points: the errors [m], their weights from 0 to 1, and their derivatives by x, y and theta,
        computed with the normals of the lines, and with those of the points themselves.
    noise : float [m]
        Standard deviation of a range. It adds to the spread of the errors.
    parameters : DecisionParameters
    theta : float [rad]
        Rotation of the scan in the frame of the residuals.
    latest_degenerate : bool
        Whether the translation to the latest key frame is degenerate: older ones have to constrain it beyond chance.
    rotation_unobservable : bool
        Whether the rotation is unobservable, whatever the residuals say.
    """
    cdef Limits limits = limits_of(parameters)
    cdef Uncertainty found
    with nogil:
        found = estimate(table, noise, &limits, theta, latest_degenerate, rotation_unobservable)
    return covariance_of(&found), Observability(found.angle, found.weak, found.rotation)


cdef covariance_of(Uncertainty *found):
    """Return the covariance as an array ``(3, 3)``."""
    covariance = np.empty((3, 3))
    cdef double[:, ::1] rows = covariance
    memcpy(&rows[0, 0], found.covariance, sizeof(found.covariance))
    return covariance


def shared_information(const double[:, ::1] table):
    """Return the information ``(3, 3)`` of points with unit standard deviation, as far as it is shared by both scans.

    Each product combines the normal of the line with the normal of the point itself. Independent noise of the two
    normals cancels, so that a smooth wall does not seem to constrain the motion along the wall. The result may be
    indefinite if there is only noise. The `table` is that of `match_covariance`.
    """
    cdef double[3] motion = [0.0, 0.0, 0.0]
    cdef Symmetric shared = shared_of(table, motion, 0.0)
    information = np.empty((3, 3))
    cdef double[:, ::1] rows = information
    write_rows(&shared, &rows[0, 0])
    return information


def degenerate_translation(double angle, const double[:, ::1] shared, parameters):
    """Return ``(3,)`` [m, m, rad]: a translation of 1 m along `angle` [rad], and the rotation coupled with it.

    A direction may be degenerate only together with a rotation, as along the wall of a circular room. The rotation
    follows from the `shared` information ``(3, 3)``.
    """
    cdef Symmetric upper = symmetric(shared)
    cdef double[3] along
    write_degenerate(angle, &upper, parameters.min_information, along)
    return np.array((along[0], along[1], along[2]))


def degenerate_rotation(const double[:, ::1] information, const double[:, ::1] shared, parameters):
    """Return ``(3,)`` [m, m, rad]: a rotation of 1 rad, and the translation coupled with it, by two ``(3, 3)``."""
    cdef Symmetric all_upper = symmetric(information), shared_upper = symmetric(shared)
    cdef Rotation rotation = constrained_rotation(&shared_upper, &all_upper, parameters.min_information)
    return np.array((rotation.x, rotation.y, 1.0))


cdef Limits limits_of(parameters) except *:
    """Return the numbers of `DecisionParameters`."""
    return Limits(parameters.min_information, parameters.weak_prior_information, parameters.parallel_tolerance,
                  parameters.covariance_scale, parameters.few_points_scale)


cdef Uncertainty estimate(const double[:, ::1] table, double noise, Limits *limits, double theta,
                          bint latest_degenerate, bint rotation_unobservable) noexcept nogil:
    """Estimate what `match_covariance` returns."""
    cdef Spread spread
    cdef Symmetric information = information_of(table, &spread), shared
    cdef double[3] motion = [0.0, 0.0, 0.0]
    cdef Weakest weakest, seeming
    cdef Rotation rotation, noisy
    cdef double chance, remaining
    cdef Uncertainty found
    shared = shared_of(table, motion, 0.0)
    weakest = weakest_of(&shared)
    if weakest.weak < limits.weak_prior and is_corridor_like(&shared, weakest.angle):
        write_parallel(weakest.angle, &shared, limits.min_information, motion)
        shared = shared_of(table, motion, limits.parallel_tolerance)
        weakest = weakest_of(&shared)
    # Where only noise constrains the rotation, as much of it as agrees by chance is subtracted.
    rotation = constrained_rotation(&shared, &information, limits.min_information)
    noisy = constrained_rotation(&information, &information, limits.min_information)
    chance = SIGMAS * sqrt(DEPENDENT / max(spread.count, 1.0))
    remaining = max(rotation.information - chance * max(noisy.information - rotation.information, 0.0), 0.0)
    if latest_degenerate:
        seeming = weakest_of(&information)
        weakest.weak = max(weakest.weak - chance * (seeming.weak - weakest.weak), 0.0)
    if rotation_unobservable:
        remaining = 0.0
    found.angle, found.weak, found.rotation = weakest.angle, weakest.weak, remaining
    write_calibrated(&information, &shared, spread.squares / max(spread.count, TINY) + noise * noise, &weakest,
                     remaining < limits.min_information, &rotation, limits, found.covariance)
    turn(found.covariance, -theta)
    return found


cdef struct Rotation:
    # Information about the rotation, and the translation along x and y [m/rad] that compensates it best.
    double information, x, y


cdef Rotation constrained_rotation(Symmetric *shared, Symmetric *information,
                                   double min_information) noexcept nogil:
    """Find how well the `shared` information constrains the rotation, for an unknown translation."""
    cdef double xx = information.xx + min_information, yy = information.yy + min_information, xy = information.xy
    cdef double determinant = xx * yy - xy * xy
    cdef double x = (xy * shared.yt - yy * shared.xt) / determinant, y = (xy * shared.xt - xx * shared.yt) / determinant
    return Rotation(shared.tt + x * shared.xt + y * shared.yt, x, y)


cdef void write_calibrated(Symmetric *information, Symmetric *shared, double variance, Weakest *weakest,
                           bint no_rotation, Rotation *rotation, Limits *limits, double *covariance) noexcept nogil:
    """Write the covariance of a motion from the information of its points, and the `variance` [m^2] of one.

    Few points along a direction are less certain than their number says, as their errors are not independent. A
    direction that fewer than `decision.min_information` points constrain gets the variance of an unknown motion.
    """
    cdef double extra = 1.0 / PRIOR_INFORMATION[0]
    cdef double[3] along
    cdef double[3] turning = [rotation.x, rotation.y, 1.0]
    cdef Symmetric posterior
    cdef Py_ssize_t i, j
    variance *= limits.covariance_scale
    posterior = Symmetric(information.xx / variance + PRIOR_INFORMATION[0], information.xy / variance,
                          information.xt / variance, information.yy / variance + PRIOR_INFORMATION[1],
                          information.yt / variance, information.tt / variance + PRIOR_INFORMATION[2])
    posterior = inverse_of(&posterior)
    write_rows(&posterior, covariance)
    write_degenerate(weakest.angle, shared, limits.min_information, along)
    if weakest.weak >= limits.min_information:
        extra = min(variance * limits.few_points_scale / (weakest.weak * weakest.weak), extra)
    for i in range(3):
        for j in range(3):
            covariance[3 * i + j] += extra * along[i] * along[j]
            if no_rotation:
                covariance[3 * i + j] += turning[i] * turning[j] / PRIOR_INFORMATION[2]


cdef double translational(Symmetric *information, double angle) noexcept nogil:
    """Return the information about the translation along `angle` [rad] for a known rotation."""
    cdef double c = cos(angle), s = sin(angle)
    return c * c * information.xx + 2.0 * c * s * information.xy + s * s * information.yy


cdef void write_degenerate(double angle, Symmetric *shared, double min_information,
                           double *along) noexcept nogil:
    """Write a translation of 1 m along `angle` [rad], and the rotation [rad] that goes with it."""
    cdef double c = cos(angle), s = sin(angle)
    along[0], along[1], along[2] = c, s, 0.0
    if min(translational(shared, angle), shared.tt) > min_information:
        along[2] = -(shared.xt * c + shared.yt * s) / shared.tt


cdef void write_parallel(double angle, Symmetric *information, double min_information,
                         double *motion) noexcept nogil:
    """Write the motion along `angle` [rad] that walls of a corridor are parallel to: a translation of 1 m or an arc."""
    cdef double straight = translational(information, angle), bend
    write_degenerate(angle, information, min_information, motion)
    bend = information.xt * motion[0] + information.yt * motion[1]
    if straight + motion[2] * bend >= CORRIDOR_RATIO * straight:
        motion[2] = 0.0


cdef bint is_corridor_like(Symmetric *information, double angle) noexcept nogil:
    """Whether few points face along the direction `angle` [rad], by their information."""
    return translational(information, angle) < CORRIDOR_RATIO * (information.xx + information.yy)


cdef double wall_direction(const double[:, ::1] table) noexcept nogil:
    """Return the direction [rad] of the walls that run along the weakest direction of all points.

    Normals that stray from these walls are left out, so that those of a scattered surface hardly turn it.
    """
    cdef double[3] motion = [0.0, 0.0, 0.0]
    cdef Symmetric shared = shared_of(table, motion, 0.0), sums
    cdef double angle = weakest_of(&shared).angle, c, s, x, y
    cdef Py_ssize_t again, k
    for again in range(2):
        sums, c, s = Symmetric(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), cos(angle), sin(angle)
        for k in range(table.shape[1]):
            x, y = table[BY_X, k], table[BY_Y, k]
            if fabs(c * x + s * y) < NEARLY_PARALLEL[again] * length_of(x, y):
                sums.xx += table[WEIGHT, k] * x * x
                sums.xy += table[WEIGHT, k] * x * y
                sums.yy += table[WEIGHT, k] * y * y
        if sums.xx + sums.yy > 0.0:
            angle = weakest_direction(sums.xx, sums.xy, 0.0, sums.yy, 0.0, 0.0).angle
    return angle


cdef void make_walls_parallel(double[:, ::1] table, double angle) noexcept nogil:
    """Remove the components of all normals along a direction [rad]: they constrain no motion along it."""
    cdef double c = cos(angle), s = sin(angle), line, own
    cdef Py_ssize_t k
    for k in range(table.shape[1]):
        line, own = c * table[BY_X, k] + s * table[BY_Y, k], c * table[OWN_X, k] + s * table[OWN_Y, k]
        table[BY_X, k], table[BY_Y, k] = table[BY_X, k] - c * line, table[BY_Y, k] - s * line
        table[OWN_X, k], table[OWN_Y, k] = table[OWN_X, k] - c * own, table[OWN_Y, k] - s * own


cdef struct Spread:
    # Sums of the weights, and of the weighted squares of the errors [m^2].
    double count, squares


@cython.boundscheck(False)
cdef Symmetric information_of(const double[:, ::1] table, Spread *spread) noexcept nogil:
    """Return the information of all points by the normals of the lines, and write the `spread` of their errors."""
    cdef Symmetric found = Symmetric(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cdef double weight, x, y, theta
    cdef Py_ssize_t k
    spread[0] = Spread(0.0, 0.0)
    for k in range(table.shape[1]):
        weight, x, y, theta = table[WEIGHT, k], table[BY_X, k], table[BY_Y, k], table[BY_THETA, k]
        spread.count += weight
        spread.squares += table[ERROR, k] * table[ERROR, k] * weight
        found.xx += weight * x * x
        found.xy += weight * x * y
        found.xt += weight * x * theta
        found.yy += weight * y * y
        found.yt += weight * y * theta
        found.tt += weight * theta * theta
    return found


@cython.boundscheck(False)
cdef Symmetric shared_of(const double[:, ::1] table, const double *motion, double min_component) noexcept nogil:
    """Return the symmetric part of the products of the lines' Jacobian and the points' own.

    Walls that the `motion` moves by less than `min_component` [m] across themselves count as parallel to it.
    """
    cdef Symmetric found = Symmetric(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    cdef double half, x, y, theta, own_x, own_y, own_theta, across, off
    cdef Py_ssize_t k
    for k in range(table.shape[1]):
        x, y, theta = table[BY_X, k], table[BY_Y, k], table[BY_THETA, k]
        own_x, own_y, own_theta = table[OWN_X, k], table[OWN_Y, k], table[OWN_THETA, k]
        if min_component > 0.0:
            across = motion[0] * x + motion[1] * y + motion[2] * theta
            if fabs(across) < min_component * length_of(x, y):
                off = motion[0] * own_x + motion[1] * own_y + motion[2] * own_theta
                x, y = x - motion[0] * across, y - motion[1] * across
                own_x, own_y = own_x - motion[0] * off, own_y - motion[1] * off
        half = 0.5 * table[WEIGHT, k]
        found.xx += half * (x * own_x + x * own_x)
        found.xy += half * (x * own_y + y * own_x)
        found.xt += half * (x * own_theta + theta * own_x)
        found.yy += half * (y * own_y + y * own_y)
        found.yt += half * (y * own_theta + theta * own_y)
        found.tt += half * (theta * own_theta + theta * own_theta)
    return found
