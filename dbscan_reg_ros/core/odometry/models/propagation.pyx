# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, binding=True, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Covariance of pose and twist, propagated from scan to scan."""
import numpy as np

from libc.math cimport M_PI, cos, fabs, fmax, hypot, sin, sqrt

from ...geometry.se2 import turned
from ...geometry.tolerance import RESOLUTION, TINY

from ...geometry.matrices cimport multiply, sandwich
from ...geometry.se2 cimport SE2

# Variance of the resolution of a lidar [m^2, rad^2], which is added to every published one.
cdef double LEAST = RESOLUTION ** 2
NOTHING = np.zeros((3, 3))


cdef class CovariancePropagation:
    """Joint covariance of the errors of pose and twist, in the frame of the sensor [m, m, rad; m/s, m/s, rad/s].

    Along a degenerate direction the error of the twist remains, and the error of the pose grows accordingly.

    Parameters
    ----------
    joint : (9, 9) float, optional
        Blocks of three: errors of the pose, of the pose relative to the latest key frame, and of the twist. By default
        the pose is known, and the twist is not.

    Attributes
    ----------
    pose : (3, 3) float
        Covariance of the pose, without that of motions which were `unobserved`.
    twist : (3, 3) float
        Covariance of the twist.
    unobserved : (3, 3) float
        Covariance of the pose due to motions while no scan was registered; no later scan reduces it.
    """

    cdef double[9][9] _joint
    cdef double[3][3] missed
    cdef bint has_missed, starts_key_frame
    # Covariance of the last pose relative to the key frames before it, if it starts a key frame.
    cdef double[3][3] key_frame_error
    # Largest speeds and turn rate of the drive.
    cdef double[3] fastest

    def __init__(self, const double[:, :] joint=None):
        cdef Py_ssize_t i, j
        for i in range(3):
            self.fastest[i] = 1.0
        self.reset_twist()
        if joint is not None:
            for i in range(9):
                for j in range(9):
                    self._joint[i][j] = joint[i, j]

    @property
    def joint(self):
        return block(&self._joint[0][0], 9, 9)

    @property
    def pose(self):
        return block(&self._joint[0][0], 9, 3)

    @property
    def twist(self):
        return block(&self._joint[6][6], 9, 3)

    @property
    def unobserved(self):
        return block(&self.missed[0][0], 3, 3)

    cpdef reset_twist(self):
        """Reset the twist covariance to the covariance of an unknown twist."""
        cdef Py_ssize_t i, k
        for i in range(6, 9):
            for k in range(9):
                self._joint[i][k] = self._joint[k][i] = i == k
        self.starts_key_frame = False

    def reduce_heading(self, double ratio):
        """Multiply the standard deviation of the heading by a `ratio`."""
        cdef Py_ssize_t k
        for k in range(9):
            self._joint[2][k] *= ratio
        for k in range(9):
            self._joint[k][2] *= ratio

    cpdef start_key_frame(self, along=None):
        """Start a key frame at the current pose: from now on, errors are accumulated relative to this pose.

        The next scan is aligned with the key frames before as well: the error of this pose is one of the next twist.

        Parameters
        ----------
        along : float [rad], optional
            The only direction of the translation, in the frame of the sensor, in which scans are aligned with this key
            frame from now on: in all others with the latest one. By default in every direction.
        """
        cdef double[3][3] started, error
        cdef double[9][9] kept
        cdef Py_ssize_t i, k
        direction = None if along is None else np.array([cos(along), sin(along), 0.0])
        read(np.eye(3) if along is None else np.outer(direction, direction), started)
        for i in range(9):
            for k in range(9):
                kept[i][k] = (i == k) - (started[i - 3][k - 3] if 3 <= i < 6 and 3 <= k < 6 else 0.0)
        read(block(&self._joint[3][3], 9, 3), error)
        sandwich(&started[0][0], 3, &error[0][0], 3, &self.key_frame_error[0][0])
        sandwich(&kept[0][0], 9, &self._joint[0][0], 9, &self._joint[0][0])
        self.starts_key_frame = True

    def observe(self, const double[:] twist):
        """Remember the largest speed and turn rate of the drive, at least 1 m/s and 1 rad/s; `twist` is reliable."""
        cdef double speed = hypot(twist[0], twist[1])
        self.fastest[0], self.fastest[1] = fmax(self.fastest[0], speed), fmax(self.fastest[1], speed)
        self.fastest[2] = fmax(self.fastest[2], fabs(twist[2]))

    def add_unknown_motion(self, double time):
        """Add the covariance of a motion that was not observed for a `time` [s], and start a new key frame."""
        cdef double sigma
        cdef Py_ssize_t k
        for k in range(3):
            sigma = self.fastest[k] * max(time, 1.0)
            sigma = min(sigma, M_PI) if k == 2 else sigma
            self.missed[k][k] += sigma * sigma
        self.has_missed = True
        self.start_key_frame()
        self.reset_twist()

    def propagate(self, SE2 step, double interval, prior, gain=None, measured=None):
        """Propagate all covariances over a `step`.

        Parameters
        ----------
        step : SE2
            Motion since the last scan, in the last scan's frame.
        interval : float [s]
            Time since the last scan; 0 where unknown: it resets the twist. It is negative if the scan is older than the
            state; then its absolute value is used.
        prior : Prior
            The predicted step.
        gain : (3, 3) float, optional
            Kalman gain of the alignment with the map, in the frame of the scan: with the identity the corrected pose is
            the aligned one, with 0, the default, the predicted one.
        measured : (3, 3) float, optional
            Covariance of the pose from the alignment with the map alone, in the frame of the scan [m, m, rad].
        """
        cdef SE2 back = step.inverse()
        cdef double c = cos(back.theta), s = sin(back.theta)
        cdef double[3][3] adjoint = [[c, -s, back.y], [s, c, -back.x], [0.0, 0.0, 1.0]], effect, added
        cdef double[3][3] correction, covariance
        cdef Py_ssize_t i, k
        interval = fabs(interval)
        read(NOTHING if gain is None else gain, correction)
        read(NOTHING if gain is None else measured, covariance)
        self._propagate_errors(adjoint, interval, prior, correction, covariance)
        if self.has_missed:
            sandwich(&adjoint[0][0], 3, &self.missed[0][0], 3, &self.missed[0][0])
        if not interval:
            self.reset_twist()
        elif self.starts_key_frame:
            multiply(correction, adjoint, effect)
            for i in range(3):
                for k in range(3):
                    effect[i][k] /= interval
            sandwich(&effect[0][0], 3, &self.key_frame_error[0][0], 3, &added[0][0])
            for i in range(3):
                for k in range(3):
                    self._joint[6 + i][6 + k] += added[i][k]
            self.starts_key_frame = False
        self._bound_twist()

    cdef int _propagate_errors(self, double[3][3] adjoint, double interval, prior, double[3][3] gain,
                               double[3][3] measured) except -1:
        """Propagate the joint covariance: T E T', with a transition T of independent errors of the covariance E.

        The errors are those of `joint`, of the change of the twist, of the rest of the prediction, and of the
        alignment with the map.
        """
        cdef double[3][3] covariance, change
        # The error of the twist repeats where the prediction is by the velocity.
        cdef bint by_velocity = prior.velocity_change is not None
        cdef double rate = 1.0 / interval if interval > 0.0 else 0.0, fading
        cdef double[9][18] transition
        cdef double[18][18] errors
        cdef Py_ssize_t i, j, k
        read(prior.covariance, covariance)
        read(prior.velocity_change if by_velocity else prior.covariance, change)
        for i in range(18):
            for j in range(18):
                errors[i][j] = self._joint[i][j] if i < 9 and j < 9 else 0.0
        for i in range(3):
            for j in range(3):
                errors[9 + i][9 + j] = change[i][j]
                errors[12 + i][12 + j] = covariance[i][j] - change[i][j]
                errors[15 + i][15 + j] = measured[i][j]
                # The effect on the error of the step. The alignment removes the error made since the key frame.
                transition[i][j] = transition[i][3 + j] = 0.0
                for k in range(3):
                    transition[i][3 + j] -= gain[i][k] * adjoint[k][j]
                transition[i][9 + j] = transition[i][12 + j] = (i == j) - gain[i][j]
                transition[i][15 + j] = gain[i][j]
                # The variance of the twist stays below that of an unknown one: old errors fade as new ones are added.
                fading = sqrt(max(1.0 - rate * rate * change[j][j], 0.0)) if by_velocity else 0.0
                transition[i][6 + j] = interval * fading * ((i == j) - gain[i][j])
        for i in range(3):
            for j in range(18):
                transition[3 + i][j] = transition[i][j]
                transition[6 + i][j] = 0.0 if 12 <= j < 15 else rate * transition[i][j]
        for i in range(3):
            for j in range(3):
                transition[i][j] += adjoint[i][j]
                transition[3 + i][3 + j] += adjoint[i][j]
        sandwich(&transition[0][0], 9, &errors[0][0], 18, &self._joint[0][0])
        return 0

    cdef _bound_twist(self):
        """Scale the twist covariance down if it exceeds the covariance set by `reset_twist` in any direction."""
        cdef double[9][9] scale
        cdef double[:, :] twist_scale
        cdef Py_ssize_t i, k
        if self._joint[6][6] + self._joint[7][7] + self._joint[8][8] <= 1.0:
            return
        variance, directions = np.linalg.eigh(self.twist)
        if variance[2] > 1.0:
            twist_scale = directions / np.sqrt(np.maximum(variance, 1.0)) @ directions.T
            for i in range(9):
                for k in range(9):
                    scale[i][k] = twist_scale[i - 6, k - 6] if i >= 6 and k >= 6 else i == k
            sandwich(&scale[0][0], 9, &self._joint[0][0], 9, &self._joint[0][0])

    def published(self, double heading):
        """Return the covariance ``(3, 3)`` of the pose with a `heading` [rad] in the odometry frame [m, m, rad]."""
        return with_resolution(turned(coordinate_covariance(self.pose) + self.unobserved, heading))

    def published_twist(self, const double[:] added):
        """Return the covariance ``(3, 3)`` of the twist; what is added to an unknown one stays within 1 m/s and 1 rad/s.

        Parameters
        ----------
        added : (3,) float
            Variances that are added.
        """
        cdef double most = max(added[0], added[1], added[2]), share = 1.0
        cdef Py_ssize_t k
        covariance = self.twist
        cdef double[:, ::1] entry = covariance
        if entry[0, 0] + entry[1, 1] + entry[2, 2] + most > 1.0:
            share = min(max(1.0 - np.linalg.eigvalsh(covariance)[2], 0.0) / max(most, <double> TINY), 1.0)
        for k in range(3):
            entry[k, k] += share * added[k]
        return with_resolution(covariance)


cdef block(const double *first, Py_ssize_t row, Py_ssize_t size):
    """Return a copy ``(size, size)`` of a block of a matrix whose rows are `row` numbers apart."""
    result = np.empty((size, size))
    cdef double[:, ::1] entry = result
    cdef Py_ssize_t i, k
    for i in range(size):
        for k in range(size):
            entry[i, k] = first[i * row + k]
    return result


cdef int read(matrix, double[3][3] result) except -1:
    """Copy a ``(3, 3)`` matrix."""
    cdef const double[:, :] entry = np.asarray(matrix, dtype=float)
    cdef Py_ssize_t i, k
    for i in range(3):
        for k in range(3):
            result[i][k] = entry[i, k]
    return 0


cdef with_resolution(double[:, ::1] covariance):
    """Add the resolution of a lidar to a covariance ``(3, 3)``."""
    cdef Py_ssize_t k
    for k in range(3):
        covariance[k, k] += LEAST
    return np.asarray(covariance)


def coordinate_covariance(const double[:, :] covariance):
    """Convert a pose `covariance` ``(3, 3)`` in the tangent space to one of x, y and theta, to second order.

    The error of a pose is a twist in the frame of the sensor. A translation combined with a rotation is an arc: it ends
    beside its tangent, at a distance of half the product of rotation and translation. Source: Barfoot and Furgale,
    "Associating Uncertainty With Three-Dimensional Poses for Use in Estimation Problems", 2014.
    """
    cdef double xx = covariance[0, 0], xy = covariance[0, 1], xt = covariance[0, 2]
    cdef double yy = covariance[1, 1], yt = covariance[1, 2], tt = covariance[2, 2], across = -(xy * tt + 2.0 * xt * yt)
    result = np.array(covariance)
    cdef double[:, ::1] entry = result
    entry[0, 0] += 0.25 * (yy * tt + 2.0 * yt * yt)
    entry[0, 1] += 0.25 * across
    entry[1, 0] += 0.25 * across
    entry[1, 1] += 0.25 * (xx * tt + 2.0 * xt * xt)
    return result
