# SPDX-License-Identifier: Apache-2.0
"""The walls of a building as a compass: most of them face two directions at right angles, and show how far a heading has drifted."""
import math

import numpy as np

from ...features.records import Segments
from ...geometry.robust_kernel import kernel
from ...geometry.se2 import SE2
from ...parameters.odometry import ManhattanParameters
from ...registration.rotation import wrap_period


class ManhattanHeading:
    """The directions that most walls on the way share, modulo a right angle (Coughlan and Yuille, "Manhattan World", ICCV 1999).

    A Kalman filter of three angles [rad]: how far the heading has drifted, a random walk; how far the walls in sight are from
    the directions of most, which other walls are not; and these directions themselves. What is found to be drift is taken out
    at once.
    """

    def __init__(self):
        self._covariance = np.zeros((3, 3))
        self._forget()

    def _forget(self):
        """Know of no walls."""
        self._direction, self._deviation = None, 0.0
        self._along = self._seen = self._way = self._distance = 0.0

    def propagate(self, step: SE2):
        """Go on by a `step`."""
        distance = math.hypot(step.x, step.y)
        self._distance += distance
        self._way += math.hypot(distance, step.theta)

    def observe(self, segments: Segments, heading, parameters: ManhattanParameters):
        """What the walls in sight say of the heading.

        Parameters
        ----------
        segments : Segments
            Of a scan.
        heading : float [rad]
            Of the sensor.
        parameters : ManhattanParameters

        Returns
        -------
        turn : float [rad]
            By which the heading has to be corrected.
        share : float
            Of the standard deviation of its error, what is left.
        """
        p = parameters
        self._pass_on(p)
        long = segments.length > _LONG
        length, directions = segments.length[long], segments.direction[long] + heading
        if not len(length):
            return 0.0, 1.0
        if self._direction is None:
            self._direction = _densest(directions, length, p.direction_sigma)
            drift = self._covariance[0, 0]
            self._covariance = np.diag((drift, p.wall_sigma ** 2, _UNKNOWN ** 2))
        off, along = _mode(wrap_period(directions - self._direction - self._deviation, _RIGHT), length, p.direction_sigma)
        common = self._covariance.sum(0)
        variance = common.sum() + _NOISE ** 2 * max(_PLENTY / along, 1.0)
        if off * off > _LIMIT ** 2 * variance:
            along = 0.0
        self._along, self._seen = self._along + along, self._seen + length.sum()
        aligned = self._along / self._seen
        if aligned < _FORGOTTEN * p.min_aligned_ratio:
            self._forget()
        if aligned < p.min_aligned_ratio or not along:
            return 0.0, 1.0
        gain, before = common / variance, self._covariance[0, 0]
        self._covariance = self._covariance - gain[:, None] * common
        self._deviation += gain[1] * off
        self._direction += gain[2] * off
        return -gain[0] * off, math.sqrt(max(self._covariance[0, 0], 0.0) / before) if before else 1.0

    def _pass_on(self, p):
        """Make up for the way since the last walls."""
        keep = math.exp(-self._distance / p.correlation_distance)
        kept = np.array((1.0, keep, 1.0))
        self._covariance = kept[:, None] * self._covariance * kept
        self._covariance[0, 0] += p.heading_drift ** 2 * self._way
        self._covariance[1, 1] += (1.0 - keep * keep) * p.wall_sigma ** 2
        self._deviation, self._along, self._seen = keep * self._deviation, keep * self._along, keep * self._seen
        self._way = self._distance = 0.0


def _densest(directions, length, tolerance):
    """Of the `directions` [rad] the one with the most walls [m] around it."""
    return directions[(kernel(wrap_period(directions[:, None] - directions, _RIGHT), tolerance) @ length).argmax()]


def _mode(off, length, tolerance):
    """Where the walls [m] that are `off` [rad] by least are thickest, by mean shift, and how many of them [m] lie there."""
    mean = 0.0
    for _ in range(_SHIFTS):
        near = length * kernel(off - mean, tolerance)
        along = near.sum() + 1e-9
        mean = near @ off / along
    return mean, along


_RIGHT = 0.5 * math.pi
_LONG = 0.7
"""Walls shorter than this [m] are furniture."""
_NOISE = 0.009
"""Of what one scan shows of the direction of `_PLENTY` [m] of walls [rad]."""
_PLENTY = 3.0
_UNKNOWN = 2.0
"""Spread of directions of which nothing is known [rad]."""
_LIMIT = 2.0
"""What is farther off than so many standard deviations is another direction."""
_SHIFTS = 3
_FORGOTTEN = 0.5
"""Where no more than this part of the share of walls that is asked for lies along the directions, others are looked for."""
