# SPDX-License-Identifier: Apache-2.0
"""The motion that goes on: what is expected of the next scan when nobody tells of it."""
import math

import numpy as np

from ...geometry.se2 import SE2
from ...parameters.tree import Parameters
from ...registration.records import Prior
from .stamps import ScanInterval


class ConstantVelocityModel:
    """How the sensor moves, by where its scans were found.

    Parameters
    ----------
    pose : SE2
        Where it is at first.

    Attributes
    ----------
    twist : (3,) array [m/s, m/s, rad/s]
        In the sensor's own frame.
    """

    def __init__(self, pose: SE2):
        self.reset_velocity()
        self.start_moving(pose, self.twist, 0.0)
        self._since, self._free = 0.0, None

    def reset_velocity(self):
        """Expect no motion."""
        self._step, self.twist, self._velocities = SE2(), np.zeros(3), []

    def start_moving(self, pose: SE2, twist, half):
        """Move at a `twist` from `pose` on, which lies a time of `half` [s] before the middle of its scan."""
        self.twist = twist
        self._middle = self._held = pose @ travel(twist, half)

    def coast(self, pose: SE2, half):
        """Be at a `pose` that was only expected."""
        self._middle = pose @ travel(self.twist, half)

    def forget_position(self):
        """Know no longer where the last scan was: the way from there to the next is no motion."""
        self._middle = None

    @property
    def position_unknown(self):
        """Whether nothing is known of where the last scan was."""
        return self._middle is None

    @property
    def has_velocity(self):
        """Whether it is known how the sensor moves."""
        return bool(self._velocities)

    def elapse(self, interval):
        """Let time [s] pass."""
        self._since += interval

    def predict(self, time: ScanInterval, parameters: Parameters) -> Prior:
        """The last motion once more; its spread grows with the interval and with the motion itself."""
        p = parameters.prior
        unknown = self._step is None or parameters.odometry.prior == 'none'
        step = SE2() if unknown or time.jump else self._step
        if unknown or time.gap:
            return Prior(step, unknown_motion_covariance(time, parameters))
        if time.steady and self._velocities and not 1.0 / _ALIKE < time.interval / self._lasted < _ALIKE:
            # Scans were lost, now or before.
            step = travel(self._usual_twist(), time.interval)
        # No turn is farther off than half of one, however long it had time: the prior still tells there from back.
        farthest = math.pi / p.gate
        faster, faster_turn = p.acceleration * time.interval ** 2, min(p.angular_acceleration * time.interval ** 2, farthest)
        sigma = math.hypot(p.min_sigma, faster, p.stamp_jitter * math.hypot(step.x, step.y))
        turn = min(math.hypot(p.min_rotation_sigma, faster_turn, p.stamp_jitter * step.theta), farthest)
        return Prior(step, np.diag((sigma * sigma, sigma * sigma, turn * turn)), np.diag((faster, faster, faster_turn)) ** 2)

    def gate_covariance(self, prior: Prior, expected: SE2, lost, parameters: Parameters):
        """Covariance of a scan that is `expected` by a prior, when those before it were found nowhere for a time of `lost` [s].

        The motion may have changed since. Along a direction that was left free it may have done so before: no farther, though,
        than a place along it is searched for.
        """
        covariance = prior.covariance
        if prior.velocity_change is None:
            return covariance
        if lost:
            way, turn = _changed(min(lost, parameters.time.max_jump), parameters)
            covariance = covariance + np.diag((way, way, turn)) ** 2
        if self._free is not None:
            angle = self._free - expected.theta
            farther = min(_changed(self._since, parameters)[0], parameters.degeneracy.search_distance)
            along = np.array((math.cos(angle), math.sin(angle), 0.0))
            covariance = covariance + farther ** 2 * along[:, None] * along
        return covariance

    def update(self, pose: SE2, time: ScanInterval, free, share, turns, parameters: Parameters) -> SE2:
        """Go on to where the scan was found; the pose at its stamp is returned.

        The points lie where the twist of the scan before carried them. An error of that twist turns into one of the pose
        at the stamp, not of the pose in the middle of the scan: the new twist comes from the middles. Where the scan before
        was found nowhere no motion is known. Along a direction that the scan leaves `free` [rad] the speed stays as it was, but
        for a `share`. Once a scan holds that direction again the speed follows from the way since one did so last. Where the
        scan `turns` freely, too, what is free is a way with a turn: no speed along one direction stays.
        """
        if turns:
            free = self._free = None
        middle = pose @ travel(self.twist, time.middle_offset)
        before, self._middle = self._middle, middle
        if before is None:
            self.reset_velocity()
            self._step = None
        elif time.interval > 0.0 and time.elapsed > 0.0 and not time.gap:
            usual = self._usual_twist()
            self.twist = (before.inverse() @ middle).as_array() / time.interval
            if free is not None:
                self._set_speed(usual[:2], free - middle.theta, 1.0 - share)
            elif self._free is not None:
                back = (middle.inverse() @ self._held).as_array()
                faster = -back[:2] / self._since - usual[:2]
                self._set_speed(usual[:2] + _WANDERS * faster, self._free - middle.theta)
            self._velocities = [*self._velocities, self.twist[:2]][-parameters.prior.velocity_window:]
            self._step, self._lasted = travel(self._usual_twist(), time.interval), time.interval
        if free is None:
            self._held, self._since = middle, 0.0
        self._free = free
        return middle @ travel(self.twist, time.middle_offset).inverse()

    def _set_speed(self, velocity, angle, share=1.0):
        """Take a `share` of the speed along `angle` [rad] from a `velocity` [m/s, m/s], both in the sensor's frame."""
        along = np.array((math.cos(angle), math.sin(angle)))
        self.twist[:2] += share * ((velocity - self.twist[:2]) @ along) * along

    def _usual_twist(self):
        """The twist that is expected to go on: the last turning rate, and the mean of the last few velocities.

        Walls always hold the rotation, but not the motion along them: a step that noise has made too long would be expected
        again, and found.
        """
        vx, vy = sum(self._velocities, np.zeros(2)) / max(len(self._velocities), 1)
        return np.array((vx, vy, self.twist[2]))


def unknown_motion_covariance(time: ScanInterval, parameters: Parameters):
    """Covariance ``(3, 3)`` of a motion of which nothing is known."""
    p = parameters.prior
    way, turn = _changed(min(time.elapsed if time.gap else time.interval, parameters.time.max_jump), parameters)
    sigma, turn = math.hypot(p.unknown_sigma, way), min(math.hypot(p.unknown_rotation_sigma, turn), _MOST_TURN)
    return np.diag([sigma, sigma, turn]) ** 2


def _changed(lasted, parameters):
    """How far [m] and by which turn [rad] a motion may have left its course in a time [s]."""
    p, half = parameters.prior, 0.5 * lasted ** 2
    return p.acceleration * half, min(p.angular_acceleration * half, _MOST_TURN)


def travel(twist, time) -> SE2:
    """Motion at a steady `twist` [m/s, m/s, rad/s] in a `time` [s]."""
    return SE2.from_array(twist * time)


_MOST_TURN = 1.0
"""Spread [rad] of a turn of which nothing is known."""
_ALIKE = 1.5
"""Intervals whose ratio is less are the same but for what stamps jitter."""
_WANDERS = 1.5
"""A speed that wanders at random has changed by so many times the change of its mean: the gain of a Kalman filter."""
