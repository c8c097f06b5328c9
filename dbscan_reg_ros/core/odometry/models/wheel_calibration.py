# SPDX-License-Identifier: Apache-2.0
"""Motions that wheels tell: what is wrong with them time and again is learned from what the scans have found."""
import math

import numpy as np

from ...geometry.se2 import SE2
from ...registration.records import Prior


class WheelCalibration:
    """What a told motion is off by, as a linear function of itself, and how far off it is beyond that.

    Wheels larger than they are thought to be make every way too short, unequal ones turn it, and a sensor that is not where it
    is said to be is carried sideways by a turn. All nine coefficients come from ridge regression of the errors on the told
    motions [m, m, rad].

    Attributes
    ----------
    matrix : (3, 3) array
        The error of a told motion is `matrix` times it.
    """

    def __init__(self):
        self._moments, self._products = _RIDGE * np.eye(3), np.zeros((3, 3))
        self._squares, self._way = np.full(3, _USUAL), _USUAL
        self._settle()

    def _settle(self):
        self.matrix = np.clip(np.linalg.solve(self._moments, self._products).T, -_MOST, _MOST)
        self._share = np.sqrt(np.clip(self._squares / self._way, _LEAST ** 2, 1.0))

    def corrected(self, told: Prior) -> Prior:
        """The motion without its systematic error, as sure as it was told."""
        motion = told.transform
        return Prior(motion @ SE2.from_array(self.matrix @ motion.as_array()), told.covariance)

    def tightened(self, prior: Prior) -> Prior:
        """The same motion, but as sure as those before have been, and never less sure than it was told."""
        return Prior(prior.transform, prior.covariance * np.outer(self._share, self._share))

    def learn(self, told: Prior, found: SE2, weights, memory):
        """Learn from one more motion.

        Parameters
        ----------
        told : Prior
        found : SE2
            What the scans say of it.
        worth : float
            What that counts, from 0 to 1.
        memory : float [m]
            What lies back by so long a way counts for 1 / e, a radian as a metre.
        """
        motion, off = told.transform.as_array(), (told.transform.inverse() @ found).as_array()
        way = math.sqrt(motion @ motion)
        keep = math.exp(-way / memory)
        rest = off - self.matrix @ motion
        seen = weights * way
        self._moments = keep * self._moments + weights * motion[:, None] * motion + (1.0 - keep) * _RIDGE * np.eye(3)
        self._products = keep * self._products + weights * motion[:, None] * off
        self._squares = keep * self._squares + seen * rest ** 2 / told.covariance.diagonal() + (1.0 - keep) * _USUAL
        self._way = keep * self._way + seen + (1.0 - keep) * _USUAL
        self._settle()


_RIDGE = 0.1
"""So large a sum of squared motions [m^2, rad^2] says as much as is known beforehand: that steps with errors of 2 cm have coefficients
of some 6 %."""
_USUAL = 1.0
"""For so long a way [m] the motions are taken to have been as sure as they were told."""
_MOST = 0.2
"""No coefficient is larger: what is farther off is wrong in another way."""
_LEAST = 0.15
"""Nor is a told motion ever taken to be surer than this share of its spread."""
