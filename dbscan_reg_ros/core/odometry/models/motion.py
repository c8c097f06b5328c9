# SPDX-License-Identifier: Apache-2.0
"""Constant-velocity motion model: predicts the motion to the next scan if there is no external prior."""
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...geometry.se2 import DOF, SE2
from ...geometry.symmetric_matrix import diagonal
from ...geometry.tolerance import TINY
from ...parameters.tree import Parameters
from ...registration.records import Prior
from .covariance import (
    displacement_covariance,
    displacement_sigma,
    motion_without_scans,
    twist_variance,
    unknown_motion_covariance,
)
from .scan_order import ScanMiddle, scan_before
from .stamps import ScanInterval


class MotionConstraints(NamedTuple):
    """How well a scan constrains the motion.

    Attributes
    ----------
    direction : float or None [rad]
        Degenerate direction of the translation in the odometry frame; None if no direction is degenerate.
    constrained : float
        How well the scan constrains the translation along `direction`, from 0 to 1.
    rotation_unobservable : bool
    """

    direction: float | None = None
    constrained: float = 1.0
    rotation_unobservable: bool = False


class ConstantVelocityModel:
    """Constant-velocity model, updated with the poses of scans.

    The velocity is computed from successive scans of the same sensor. Between scans of different sensors too little
    time passes, and an error of the mounting would count as motion; only where the last scan of the same sensor is old,
    the velocity is computed from a younger one of another sensor. All poses and velocities are of the first sensor.

    Parameters
    ----------
    pose : SE2
        First pose of the sensor in the odometry frame.
    sensor : str
        Name of the sensor of the first scan.

    Attributes
    ----------
    twist, variance : (3,) float [m/s, m/s, rad/s]
        Velocity in the frame of the sensor, and its `twist_variance`.
    unconstrained_time : float [s]
        Time since a scan last constrained every direction.
    """

    twist: NDArray[np.float64]
    unconstrained_time: float
    _middles: dict[str, ScanMiddle]
    """Last scan of each sensor that was registered successfully, by sensor name; empty if the position is unknown."""
    _constrained_count: int
    """Number of scans that constrained every direction."""
    _constrained_middle: SE2
    """Pose in the middle of the last scan that constrained every direction."""
    _degenerate_direction: float | None
    """The direction [rad] that has been degenerate since that scan; None if none is."""
    _increment: SE2 | None
    """Predicted increment; None where it is unknown."""
    _velocities: list[list[float]]

    def __init__(self, pose: SE2, sensor: str = ''):
        self.reset_velocity()
        self._constrained_count, self._degenerate_direction = 0, None
        self.start_moving(pose, self.twist, 0.0, sensor)

    def reset_velocity(self) -> None:
        """Reset the velocity to 0, and discard the velocities measured so far."""
        self._increment, self._velocities, self._last_interval, self._regular = SE2(), [], 0.0, True
        self.twist, self.variance = np.zeros((2, DOF))

    def start_moving(self, pose: SE2, twist: NDArray[np.float64], middle_offset: float, sensor: str) -> None:
        """Start at `pose` with a `twist`; the middle of the scan is `middle_offset` [s] after its stamp."""
        self.twist = twist
        self._middles = {}
        self.join(pose, middle_offset, sensor)
        self._constrained_middle, self.unconstrained_time = self._middles[sensor].pose, 0.0

    def join(self, pose: SE2, middle_offset: float, sensor: str) -> None:
        """Add the first scan of a `sensor`, without an update of the velocity; parameters as for `start_moving`."""
        middle = pose @ integrate(self.twist, middle_offset)
        self._middles[sensor] = ScanMiddle(middle, -middle_offset, False, self._constrained_count)

    def forget_position(self) -> None:
        """Discard the last poses: the displacement from them to the next scan is a correction, not a motion."""
        self._middles.clear()

    def forget_sensor(self, sensor: str) -> None:
        """Discard the last scan of a `sensor` after a gap: the mean velocity since that scan is not the present one."""
        self._middles.pop(sensor, None)

    def move(self, correction: SE2) -> None:
        """Move all stored poses by a `correction` of the odometry frame, without an update of the velocity."""
        self._constrained_middle = correction @ self._constrained_middle
        for middle in self._middles.values():
            middle.pose = correction @ middle.pose
        if self._degenerate_direction is not None:
            self._degenerate_direction += correction.theta

    @property
    def position_unknown(self) -> bool:
        """Whether no pose is stored from which a velocity could be computed."""
        return not self._middles

    @property
    def has_velocity(self) -> bool:
        """Whether a velocity has been estimated."""
        return bool(self._velocities)

    def elapse(self, interval: float) -> None:
        """Add an `interval` [s] to the age of each stored scan, and to `unconstrained_time`."""
        self.unconstrained_time += interval
        for middle in self._middles.values():
            middle.time += interval

    def predict(self, interval: ScanInterval, parameters: Parameters) -> Prior:
        """Predict the same increment as the last one; its covariance grows with the interval and with the increment.

        After a jump of the stamps the prediction is `motion_without_scans`.
        """
        p, increment = parameters.prior, self._increment
        if increment is None or parameters.odometry.prior == 'none':
            return Prior(SE2(), unknown_motion_covariance(interval, parameters))
        if interval.jump and self.has_velocity:
            return motion_without_scans(self._mean_twist(), interval, parameters)
        if interval.gap:
            return Prior(increment, unknown_motion_covariance(interval, parameters))
        if self._velocities and self._differs_from_last(interval):
            # Scans were dropped, now or before, or those of several sensors alternate.
            increment = integrate(self._mean_twist(), interval.length)
        max_sigma, square = math.pi / p.gate, interval.length ** 2  # Corridors look alike after 180 deg.
        change, rotation_change = p.acceleration * square, min(p.angular_acceleration * square, max_sigma)
        sigma = math.hypot(p.min_sigma, change, p.stamp_jitter * math.hypot(increment.x, increment.y))
        rotation_sigma = min(math.hypot(p.min_sigma, rotation_change, p.stamp_jitter * increment.theta), max_sigma)
        return Prior(increment, diagonal(sigma * sigma, sigma * sigma, rotation_sigma * rotation_sigma),
                     diagonal(change, change, rotation_change) ** 2)

    def gate_covariance(self, prior: Prior, predicted: SE2, lost_time: float,
                        parameters: Parameters) -> NDArray[np.float64]:
        """Return the covariance of a prediction, enlarged for changes of velocity that were not observed.

        Parameters
        ----------
        prior : Prior
            The prediction; the covariance of an external prior is returned unchanged.
        predicted : SE2
            Pose that the prior predicts, in the odometry frame.
        lost_time : float [s]
            Time since scans could not be registered any more: the covariance grows with it in every direction. Along a
            degenerate direction the standard deviation grows with `unconstrained_time`, by at most
            `degeneracy.search_distance`.
        parameters : Parameters

        Returns
        -------
        (3, 3) float
            Covariance in the frame of the sensor [m, m, rad].
        """
        covariance = prior.covariance
        if prior.velocity_change is None:
            return covariance
        if lost_time:
            covariance = covariance + displacement_covariance(lost_time, parameters)
        if self._degenerate_direction is not None:
            angle = self._degenerate_direction - predicted.theta
            distance = min(displacement_sigma(self.unconstrained_time, parameters)[0],
                           parameters.degeneracy.search_distance)
            along = np.array((math.cos(angle), math.sin(angle), 0.0))
            covariance = covariance + distance ** 2 * along[:, None] * along
        return covariance

    def update(self, pose: SE2, interval: ScanInterval, constraints: MotionConstraints, parameters: Parameters,
               sensor: str = '') -> SE2:
        """Update the velocity from the pose of a scan.

        The scan was deskewed with the last twist. An error of that twist shifts the pose at the stamp, but not the pose
        in the middle of the scan: the new twist is computed from the poses in the middle of the scans. Along a
        degenerate direction the velocity is kept. The next scan that constrains this direction updates the velocity
        from the displacement since the last scan that constrained it. If the rotation is unobservable too, translation
        and rotation are coupled: no velocity is kept.

        Parameters
        ----------
        pose : SE2
            Pose of the scan at its stamp in the odometry frame; the scan was deskewed with the last twist.
        interval : ScanInterval
        constraints : MotionConstraints
        parameters : Parameters
        sensor : str
            Name of the sensor of the scan.

        Returns
        -------
        SE2
            Pose of the scan at its stamp, computed from its pose in the middle with the new twist.
        """
        direction = constraints.direction
        if constraints.rotation_unobservable:
            direction = self._degenerate_direction = None
        middle, before = pose @ integrate(self.twist, interval.middle_offset), scan_before(self._middles, sensor)
        if self.position_unknown:
            self.reset_velocity()
            self._increment = None
        elif before and interval.measures_velocity(before.time + interval.middle_offset):
            predicted, last = self._mean_twist(), self.twist
            time = max(before.time + interval.middle_offset, 0.5 * interval.length)
            self.twist = (before.pose.inverse() @ middle).as_array() / time
            if direction is not None:
                self._correct_velocity(predicted[:2], direction - middle.theta, 1.0 - constraints.constrained)
            elif self._degenerate_direction is not None and self._is_unconstrained_since(before):
                self._catch_up(predicted[:2], middle, self._degenerate_direction)
            self.twist = _limited(self.twist, parameters)
            self.variance = twist_variance(self.variance, last, self.twist, time, interval.sigma)
            self._velocities = [*self._velocities, self.twist[:2].tolist()][-parameters.prior.velocity_window:]
            self._increment, self._last_interval = integrate(self._mean_twist(), interval.length), interval.length
            self._regular = not interval.of_others
        if direction is None:
            self._constrained_middle, self.unconstrained_time = middle, 0.0
            self._constrained_count += 1
        self._degenerate_direction = direction
        self._middles[sensor] = ScanMiddle(
            middle, -interval.middle_offset, direction is not None, self._constrained_count)
        return middle @ integrate(self.twist, interval.middle_offset).inverse()

    def _is_unconstrained_since(self, scan: ScanMiddle) -> bool:
        """Whether a direction was degenerate for a `scan`, and no other sensor has constrained it since."""
        return scan.degenerate and scan.constrained_count == self._constrained_count

    def _catch_up(self, predicted: NDArray[np.float64], middle: SE2, direction: float) -> None:
        """Set the velocity along a `direction` [rad] from the displacement while this direction was degenerate."""
        displacement = (middle.inverse() @ self._constrained_middle).as_array()
        change = -displacement[:2] / self.unconstrained_time - predicted
        self._correct_velocity(predicted + _RANDOM_WALK_GAIN * change, direction - middle.theta, 1.0)

    def _correct_velocity(self, velocity: NDArray[np.float64], angle: float, gain: float) -> None:
        """Correct the twist along `angle` [rad] (sensor frame) by `gain` times its difference from `velocity` [m/s]."""
        along = np.array((math.cos(angle), math.sin(angle)))
        self.twist[:2] += gain * ((velocity - self.twist[:2]) @ along) * along

    def _differs_from_last(self, interval: ScanInterval) -> bool:
        """Whether an `interval` differs from the last interval by more than the jitter of the stamps."""
        if interval.of_others or not self._regular:
            return True
        return interval.steady and not 1.0 / _SAME_INTERVAL < interval.length / self._last_interval < _SAME_INTERVAL

    def _mean_twist(self) -> NDArray[np.float64]:
        """Return the predicted twist: the mean of the latest linear velocities, and the latest turn rate.

        The turn rate needs no mean, as scans constrain the rotation well. They constrain the translation along walls
        poorly: without a mean, a step too long because of noise would be predicted again and confirm itself.
        """
        count, vx, vy = max(len(self._velocities), 1), 0.0, 0.0
        for x, y in self._velocities:
            vx, vy = vx + x, vy + y
        return np.array((vx / count, vy / count, self.twist[2]))


def _limited(twist: NDArray[np.float64], parameters: Parameters) -> NDArray[np.float64]:
    """Return a twist [m/s, m/s, rad/s], clipped to the limits of speed and turn rate."""
    p, (vx, vy, turn_rate) = parameters.odometry, twist.tolist()
    ratio = min(1.0, p.max_speed / max(math.hypot(vx, vy), TINY))
    return np.array((vx * ratio, vy * ratio, min(max(turn_rate, -p.max_turn_rate), p.max_turn_rate)))


def integrate(twist: NDArray[np.float64], time: float) -> SE2:
    """Return the motion of a constant `twist` [m/s, m/s, rad/s] in a `time` [s], to first order."""
    return SE2.from_array([each * time for each in twist.tolist()])


_SAME_INTERVAL = 1.5
"""Two intervals whose ratio is below this differ by jitter of the stamps only."""
_RANDOM_WALK_GAIN = 1.5
"""Correction of the velocity per difference between the mean velocity over an interval and the predicted velocity: for
a random walk, the velocity at the end of the interval has changed by this much more than its mean."""
