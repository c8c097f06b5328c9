# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, binding=True, boundscheck=True, wraparound=False, cdivision=True, initializedcheck=False
"""Constant-velocity motion model: predicts the motion to the next scan if there is no external prior."""
import math

import numpy as np

cimport cython
from libc.math cimport M_PI, cos, sin

from ...geometry.symmetric_matrix import diagonal
from ...parameters.registration import SEARCH_DISTANCE
from ...registration.records import Prior
from .unobserved_motion import displacement_covariance, displacement_sigma, motion_without_scans, unknown_motion_covariance

from ...geometry.se2 cimport SE2
from .scan_order cimport ScanMiddle, ScanMiddles
from .twist cimport Twist, integrated, limited, twist_variance

cdef:
    # Two intervals whose ratio is below this differ by jitter of the stamps only.
    double SAME_INTERVAL = 1.5
    # Standard deviation of the predicted motion as a fraction of it, as the stamps of most drivers jitter.
    double STAMP_JITTER = 0.3
    # For a random walk, the velocity at the end of an interval has changed by this much more than its mean over it.
    double RANDOM_WALK_GAIN = 1.5


cdef class MotionConstraints:
    """How well a scan constrains the motion.

    Attributes
    ----------
    direction : float or None [rad]
        Degenerate direction of the translation in the odometry frame; None if no direction is degenerate.
    constrained : float
        How well the scan constrains the translation along `direction`, from 0 to 1.
    rotation_unobservable : bool
    """

    cdef object direction
    cdef double constrained
    cdef bint rotation_unobservable

    def __init__(self, direction=None, double constrained=1.0, bint rotation_unobservable=False):
        self.direction, self.constrained, self.rotation_unobservable = direction, constrained, rotation_unobservable


@cython.auto_pickle(True)
cdef class ConstantVelocityModel:
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

    cdef readonly double unconstrained_time
    cdef Twist _twist, _variance
    cdef ScanMiddles _middles
    # Number of scans that constrained every direction, and the pose in the middle of the last.
    cdef Py_ssize_t _constrained_count
    cdef SE2 _constrained_middle
    # The direction [rad] that has been degenerate since that scan; None if none is.
    cdef object _degenerate_direction
    # Predicted increment; None where it is unknown.
    cdef SE2 _increment
    # The latest linear velocities (vx, vy) [m/s]; the last interval, and whether it was that between two scans of one
    # sensor.
    cdef list _velocities
    cdef double _last_interval
    cdef bint _of_one_sensor

    def __init__(self, SE2 pose, sensor=''):
        self.reset_velocity()
        self.start_moving(pose, (0.0, 0.0, 0.0), 0.0, sensor)

    @property
    def twist(self):
        return as_array(self._twist)

    @property
    def variance(self):
        return as_array(self._variance)

    cpdef reset_velocity(self):
        """Reset the velocity to 0, and discard the velocities measured so far."""
        self._increment, self._velocities, self._last_interval, self._of_one_sensor = SE2(), [], 0.0, True
        self._twist = self._variance = Twist(0.0, 0.0, 0.0)

    cpdef start_moving(self, SE2 pose, twist, double middle_offset, sensor):
        """Start at `pose` with a `twist`; the middle of the scan is `middle_offset` [s] after its stamp."""
        self._twist.x, self._twist.y, self._twist.turn = twist
        self._middles = ScanMiddles()
        self.join(pose, middle_offset, sensor)
        self._constrained_middle, self.unconstrained_time = self.moved(pose, middle_offset), 0.0

    cpdef join(self, SE2 pose, double middle_offset, sensor):
        """Add the first scan of a `sensor`, without an update of the velocity; parameters as for `start_moving`."""
        self._middles.add(sensor, self.moved(pose, middle_offset), -middle_offset, False, self._constrained_count)

    cpdef SE2 moved(self, SE2 pose, double time):
        """Return the pose a `time` [s] after the sensor was at `pose`."""
        return pose @ integrated(self._twist, time)

    def forget_position(self):
        """Discard the last poses: the displacement from them to the next scan is a correction, not a motion."""
        self._middles.scans.clear()

    def forget_sensor(self, sensor):
        """Discard the last scan of a `sensor` after a gap: the mean velocity since that scan is not the present one."""
        self._middles.scans.pop(sensor, None)

    def move(self, SE2 correction):
        """Move all stored poses by a `correction` of the odometry frame, without an update of the velocity."""
        self._constrained_middle = correction @ self._constrained_middle
        self._middles.move(correction)
        if self._degenerate_direction is not None:
            self._degenerate_direction += correction.theta

    @property
    def position_unknown(self):
        """Whether no pose is stored from which a velocity could be computed."""
        return not self._middles.scans

    @property
    def has_velocity(self):
        """Whether a velocity has been estimated."""
        return bool(self._velocities)

    def elapse(self, double interval):
        """Add an `interval` [s] to the age of each stored scan, and to `unconstrained_time`."""
        self.unconstrained_time += interval
        self._middles.elapse(interval)

    def predict(self, interval, parameters):
        """Predict the motion in an interval by the mean of the last velocities; its covariance grows with both.

        After a jump of the stamps the prediction is `motion_without_scans`.
        """
        cdef SE2 increment = self._increment
        cdef double length = interval.length, square = length * length, max_sigma, change, turn, sigma, turn_sigma
        p = parameters.prior
        if increment is None or p.source == 'none':
            return Prior(SE2(), unknown_motion_covariance(interval, parameters), measures_translation=False)
        if interval.jump and self.has_velocity:
            return motion_without_scans(as_array(self._mean_twist()), interval, parameters)
        if interval.gap:
            return Prior(increment, unknown_motion_covariance(interval, parameters), measures_translation=False)
        if self._velocities and self._differs_from_last(interval):
            # Scans were dropped, now or before, or those of several sensors alternate.
            increment = integrated(self._mean_twist(), length)
        max_sigma = M_PI / <double> p.gate  # Corridors look alike after 180 deg.
        change, turn = p.acceleration * square, min(<double> p.angular_acceleration * square, max_sigma)
        sigma = math.hypot(p.min_sigma, change, STAMP_JITTER * math.hypot(increment.x, increment.y))
        turn_sigma = min(<double> math.hypot(p.min_sigma, turn, STAMP_JITTER * increment.theta), max_sigma)
        return Prior(increment, diagonal(sigma * sigma, sigma * sigma, turn_sigma * turn_sigma),
                     diagonal(change * change, change * change, turn * turn), measures_translation=False)

    def gate_covariance(self, prior, SE2 predicted, double lost_time, parameters):
        """Return the covariance of a prediction, enlarged for changes of velocity that were not observed.

        Parameters
        ----------
        prior : Prior
            The prediction; the covariance of a measured translation is returned unchanged.
        predicted : SE2
            Pose that the prior predicts, in the odometry frame.
        lost_time : float [s]
            Time for which scans were not found: the covariance grows with it in every direction. Along a degenerate
            direction the standard deviation grows with `unconstrained_time`, by at most `SEARCH_DISTANCE`.
        parameters : Parameters

        Returns
        -------
        (3, 3) float
            Covariance in the frame of the sensor [m, m, rad].
        """
        cdef double angle, distance
        covariance = prior.covariance
        if prior.measures_translation:
            return covariance
        if lost_time:
            covariance = covariance + displacement_covariance(lost_time, parameters)
        if self._degenerate_direction is not None:
            angle = self._degenerate_direction - predicted.theta
            distance = min(displacement_sigma(self.unconstrained_time, parameters)[0],
                           SEARCH_DISTANCE)
            along = np.array((cos(angle), sin(angle), 0.0))
            covariance = covariance + distance * distance * along[:, None] * along
        return covariance

    def update(self, SE2 pose, interval, MotionConstraints constraints, parameters, sensor=''):
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
        cdef double offset = interval.middle_offset, length = interval.length, time
        cdef ScanMiddle before = self._middles.before(sensor)
        cdef SE2 middle = self.moved(pose, offset), step
        cdef Twist predicted, last
        direction = constraints.direction
        if constraints.rotation_unobservable:
            direction = self._degenerate_direction = None
        if self.position_unknown:
            self.reset_velocity()
            self._increment = None
        elif before is not None and interval.measures_velocity(before.time + offset):
            predicted, last = self._mean_twist(), self._twist
            time = max(before.time + offset, 0.5 * length)
            step = before.pose.inverse() @ middle
            self._twist = Twist(step.x / time, step.y / time, step.theta / time)
            if direction is not None:
                self._correct_velocity(predicted.x, predicted.y, direction - middle.theta,
                                       1.0 - constraints.constrained)
            elif (self._degenerate_direction is not None and before.degenerate
                  and before.constrained_count == self._constrained_count):
                # A direction was degenerate for that scan, and no other sensor has constrained it since.
                self._catch_up(predicted, middle, self._degenerate_direction)
            self._twist = limited(self._twist, parameters.odometry.max_speed, parameters.odometry.max_turn_rate)
            self._variance = twist_variance(self._variance, last, self._twist, time, interval.sigma)
            self._velocities.append((self._twist.x, self._twist.y))
            del self._velocities[:-parameters.prior.velocity_window]
            self._increment, self._last_interval = integrated(self._mean_twist(), length), length
            self._of_one_sensor = not interval.of_others
        if direction is None:
            self._constrained_middle, self.unconstrained_time = middle, 0.0
            self._constrained_count += 1
        self._degenerate_direction = direction
        self._middles.add(sensor, middle, -offset, direction is not None, self._constrained_count)
        return middle @ integrated(self._twist, offset).inverse()

    cdef _catch_up(self, Twist predicted, SE2 middle, double direction):
        """Set the velocity along a `direction` [rad] from the displacement while this direction was degenerate."""
        cdef SE2 displacement = middle.inverse() @ self._constrained_middle
        cdef double x = -displacement.x / self.unconstrained_time - predicted.x
        cdef double y = -displacement.y / self.unconstrained_time - predicted.y
        self._correct_velocity(predicted.x + RANDOM_WALK_GAIN * x, predicted.y + RANDOM_WALK_GAIN * y,
                               direction - middle.theta, 1.0)

    cdef _correct_velocity(self, double x, double y, double angle, double gain):
        """Correct the twist along `angle` [rad] (sensor frame) by `gain` times its difference from (x, y) [m/s]."""
        cdef double c = cos(angle), s = sin(angle)
        cdef double added = gain * ((x - self._twist.x) * c + (y - self._twist.y) * s)
        self._twist.x += added * c
        self._twist.y += added * s

    cdef bint _differs_from_last(self, interval):
        """Whether an `interval` differs from the last interval by more than the jitter of the stamps."""
        cdef double length = interval.length
        if interval.of_others or not self._of_one_sensor:
            return True
        return interval.steady and not 1.0 / SAME_INTERVAL < length / self._last_interval < SAME_INTERVAL

    cdef Twist _mean_twist(self):
        """Return the predicted twist: the mean of the latest linear velocities, and the latest turn rate.

        The turn rate needs no mean, as scans constrain the rotation well. They constrain the translation along walls
        poorly: without a mean, a step too long because of noise would be predicted again and confirm itself.
        """
        cdef double count = max(len(self._velocities), 1), vx = 0.0, vy = 0.0, x, y
        for x, y in self._velocities:
            vx, vy = vx + x, vy + y
        return Twist(vx / count, vy / count, self._twist.turn)


cdef inline as_array(Twist twist):
    """Return a twist as an array ``(3,)``."""
    return np.array((twist.x, twist.y, twist.turn))
