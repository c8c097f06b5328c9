# SPDX-License-Identifier: Apache-2.0
"""Covariances of motions that no scan observed."""
import math

import numpy as np
from numpy.typing import NDArray

from ...geometry.se2 import SE2
from ...geometry.symmetric_matrix import diagonal
from ...parameters.tree import Parameters
from ...registration.records import Prior
from .stamps import ScanInterval


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
    return Prior(SE2(lasting * vx, lasting * vy), diagonal(variance, variance, rotation_variance),
                 measures_translation=False)


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


_MAX_ROTATION_SIGMA = 1.0
"""Largest standard deviation [rad] of an unknown rotation."""
_VELOCITY_TIME = 5.0
"""Time constant tau [s] of the velocity: a robot of the Intel log or ACES drives as far in 4 s as at its last speed
in 2.2 and 3.5 s, and in 15 s as in 6.5 and 10.6 s."""
_SPEED_RATIO = 0.5
"""Standard deviation s of later velocities over the last speed."""
_MIN_SPEED_SIGMA = 0.5
"""Least standard deviation [m/s] of later velocities."""
