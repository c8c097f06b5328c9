# SPDX-License-Identifier: Apache-2.0
"""Covariances: of motions that no scan observed, and of pose and twist, propagated from scan to scan."""
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...geometry.se2 import DOF, SE2
from ...geometry.symmetric_matrix import diagonal
from ...parameters.tree import Parameters
from ...registration.records import Prior
from .propagation import propagate_errors
from .stamps import ScanInterval


class PoseMeasurement(NamedTuple):
    """How a scan's alignment with the map corrects its predicted pose.

    Attributes
    ----------
    gain : (3, 3) float
        Kalman gain, in the frame of the scan: with the identity the corrected pose is the aligned one, with 0 the
        predicted one.
    covariance : (3, 3) float
        Covariance of the pose from the alignment with the map alone, in the frame of the scan [m, m, rad].
    """

    gain: NDArray[np.float64]
    covariance: NDArray[np.float64]


NO_MEASUREMENT = PoseMeasurement(np.zeros((DOF, DOF)), np.zeros((DOF, DOF)))
"""Dead reckoning: the map does not correct the prediction."""

_POSE, _SINCE_KEY_FRAME, _TWIST, _TWIST_CHANGE, _PREDICTION, _MEASUREMENT = (
    slice(DOF * block, DOF * (block + 1)) for block in range(6))
"""Rows of the errors: of the pose, of the pose relative to the latest key frame, and of the twist (joint covariance);
of the change of the twist, of the rest of the prediction, and of the measurement."""


class CovariancePropagation:
    """Joint covariance of the errors of pose and twist, in the frame of the sensor [m, m, rad; m/s, m/s, rad/s].

    Along a degenerate direction the error of the twist remains, and the error of the pose grows accordingly.

    Attributes
    ----------
    unobserved : (3, 3) float
        Covariance of the pose due to motions while no scan was registered; no later scan reduces it.
    """

    _key_frame_error: NDArray[np.float64] | None
    """Covariance ``(3, 3)`` of the last pose relative to the key frames before it, if it started a key frame."""

    def __init__(self) -> None:
        self._joint, self._fastest = np.zeros((_TWIST.stop, _TWIST.stop)), np.ones(DOF)
        self.unobserved = np.zeros((DOF, DOF))
        self.reset_twist()

    @property
    def pose(self) -> NDArray[np.float64]:
        """``(3, 3)`` covariance of the pose, without that of motions which were `unobserved`."""
        return self._joint[_POSE, _POSE]

    @property
    def twist(self) -> NDArray[np.float64]:
        """``(3, 3)`` covariance of the twist."""
        return self._joint[_TWIST, _TWIST]

    def reset_twist(self) -> None:
        """Reset the twist covariance to the covariance of an unknown twist."""
        self._joint[_TWIST] = self._joint[:, _TWIST] = 0.0
        self._joint[_TWIST, _TWIST] = np.eye(DOF)
        self._key_frame_error = None

    def reduce_heading(self, ratio: float) -> None:
        """Multiply the standard deviation of the heading by a `ratio`."""
        self._joint[2] *= ratio
        self._joint[:, 2] *= ratio

    def start_key_frame(self) -> None:
        """Start a key frame at the current pose: from now on, errors are accumulated relative to this pose.

        The next scan is aligned with the key frames before as well: the error of this pose is one of the next twist.
        """
        self._key_frame_error = self._joint[_SINCE_KEY_FRAME, _SINCE_KEY_FRAME].copy()
        self._joint[_SINCE_KEY_FRAME] = self._joint[:, _SINCE_KEY_FRAME] = 0.0

    def observe(self, twist: NDArray[np.float64]) -> None:
        """Remember the largest speed and turn rate of the drive, at least 1 m/s and 1 rad/s; `twist` is reliable."""
        speed, turn_rate = math.hypot(*twist[:2]), abs(twist[2])
        self._fastest = np.maximum(self._fastest, (speed, speed, turn_rate))

    def add_unknown_motion(self, time: float) -> None:
        """Add the covariance of a motion that was not observed for a `time` [s], and start a new key frame."""
        sigma = self._fastest * max(time, 1.0)
        sigma[2] = min(sigma[2], math.pi)
        self.unobserved = self.unobserved + np.diag(sigma ** 2)
        self.start_key_frame()
        self.reset_twist()

    def propagate(self, step: SE2, interval: float, prior: Prior,
                  measurement: PoseMeasurement = NO_MEASUREMENT) -> None:
        """Propagate all covariances over a `step`; arguments as for `propagate_errors`.

        An `interval` of 0 resets the twist. If it is negative, because the scan is older than the state, its absolute
        value is used.
        """
        interval = abs(interval)
        self._joint = propagate_errors(self._joint, step, interval, prior, measurement)
        if self.unobserved.any():
            adjoint = step.inverse().adjoint()
            self.unobserved = adjoint @ self.unobserved @ adjoint.T
        if not interval:
            self.reset_twist()
        elif self._key_frame_error is not None:
            effect = measurement.gain @ step.inverse().adjoint() / interval
            self._joint[_TWIST, _TWIST] += effect @ self._key_frame_error @ effect.T
            self._key_frame_error = None
        self._bound_twist()

    def _bound_twist(self) -> None:
        """Scale the twist covariance down if it exceeds the covariance set by `reset_twist` in any direction."""
        if self.twist.trace() <= 1.0:
            return
        variance, directions = np.linalg.eigh(self.twist)
        if variance[-1] > 1.0:
            scale = np.eye(len(self._joint))
            scale[_TWIST, _TWIST] = directions / np.sqrt(np.maximum(variance, 1.0)) @ directions.T
            self._joint = scale @ self._joint @ scale


def coordinate_covariance(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert a pose `covariance` ``(3, 3)`` in the tangent space to one of x, y and theta, to second order.

    The error of a pose is a twist in the frame of the sensor. A translation combined with a rotation is an arc: it ends
    beside its tangent, at a distance of half the product of rotation and translation. Source: Barfoot and Furgale,
    "Associating Uncertainty With Three-Dimensional Poses for Use in Estimation Problems", 2014.
    """
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = covariance.tolist()
    across = -(xy * tt + 2.0 * xt * yt)
    bend = np.array(((yy * tt + 2.0 * yt * yt, across, 0.0), (across, xx * tt + 2.0 * xt * xt, 0.0), (0.0, 0.0, 0.0)))
    result: NDArray[np.float64] = covariance + bend / 2 ** 2
    return result


def twist_variance(variance: NDArray[np.float64], last: NDArray[np.float64], twist: NDArray[np.float64], time: float,
                   time_sigma: float) -> NDArray[np.float64]:
    """Return the variances by which the velocity at the stamp may differ from the mean since the scan before.

    It may have changed by half as much as the mean did, and has rotated by half the rotation. An error of the time is
    one of the velocity. A part of the last `variance` remains, as the scan was deskewed with the `last` twist.

    Parameters
    ----------
    variance : (3,) float [m^2/s^2, m^2/s^2, rad^2/s^2]
        The result for the scan before.
    last, twist : (3,) float [m/s, m/s, rad/s]
        Mean velocities up to the scan before, and since then.
    time, time_sigma : float [s]
        Time since the scan before, and its standard deviation.
    """
    vx, vy, turn_rate = twist.tolist()
    turned = turn_rate * time * np.array((vy, vx, 0.0))
    changed: NDArray[np.float64] = 0.25 * ((twist - last) ** 2 + turned ** 2) + (time_sigma / time * twist) ** 2
    return changed + _KEPT * variance


def motion_without_scans(twist: NDArray[np.float64], interval: ScanInterval, parameters: Parameters) -> Prior:
    """Predict the motion in an `interval` of length T without scans, from the last `twist` [m/s, m/s, rad/s].

    The velocity is an Ornstein-Uhlenbeck process: the last one decays as exp(-t / tau), and others with a standard
    deviation s take its place. With a = tau (1 - exp(-T / tau)) the mean of the translation is a v, and its variance in
    each direction is s^2 (2 tau (T - a) - a^2). The heading is unknown.
    """
    time, (vx, vy, _) = interval.elapsed, twist.tolist()
    lasting = _VELOCITY_TIME * -math.expm1(-time / _VELOCITY_TIME)
    sigma = max(_SPEED_RATIO * math.hypot(vx, vy), _MIN_SPEED_SIGMA)
    variance = sigma ** 2 * (2.0 * _VELOCITY_TIME * (time - lasting) - lasting ** 2)
    variance += parameters.prior.unknown_sigma ** 2
    rotation_variance = unknown_motion_covariance(interval, parameters)[2, 2]
    return Prior(SE2(lasting * vx, lasting * vy), diagonal(variance, variance, rotation_variance))


def unknown_motion_covariance(interval: ScanInterval, parameters: Parameters) -> NDArray[np.float64]:
    """Return the covariance ``(3, 3)`` [m, m, rad] of an unknown motion in an `interval`."""
    p, time = parameters.prior, interval.elapsed if interval.gap else interval.length
    distance, rotation = displacement_sigma(min(time, parameters.time.max_jump), parameters)
    sigma, rotation = math.hypot(p.unknown_sigma, distance), math.hypot(p.unknown_sigma, rotation)
    return diagonal(sigma, sigma, min(rotation, _MAX_ROTATION_SIGMA)) ** 2


def displacement_covariance(time: float, parameters: Parameters) -> NDArray[np.float64]:
    """Return the covariance ``(3, 3)`` [m, m, rad] of a motion that was not observed for a `time` [s]."""
    distance, rotation = displacement_sigma(min(time, parameters.time.max_jump), parameters)
    return diagonal(distance, distance, rotation) ** 2


def displacement_sigma(time: float, parameters: Parameters) -> tuple[float, float]:
    """Return the standard deviations [m], [rad] of the displacement due to unknown accelerations over `time` [s]."""
    p, half = parameters.prior, 0.5 * time ** 2
    return p.acceleration * half, min(p.angular_acceleration * half, _MAX_ROTATION_SIGMA)


_KEPT = 0.25
"""Fraction of the variance of a twist that remains with the next scan."""
_MAX_ROTATION_SIGMA = 1.0
"""Largest standard deviation [rad] of an unknown rotation."""
_VELOCITY_TIME = 5.0
"""Time constant tau [s] of the velocity: a robot of the Intel log or ACES drives as far in 4 s as at its last speed
in 2.2 and 3.5 s, and in 15 s as in 6.5 and 10.6 s."""
_SPEED_RATIO = 0.5
"""Standard deviation s of later velocities over the last speed."""
_MIN_SPEED_SIGMA = 0.5
"""Least standard deviation [m/s] of later velocities."""
