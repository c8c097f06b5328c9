# SPDX-License-Identifier: Apache-2.0
"""Online calibration of systematic wheel-odometry errors."""
import math

import numpy as np
from numpy.typing import NDArray

from ...geometry.se2 import DOF, SE2
from ...geometry.tolerance import SIGMAS
from ...registration.records import Prior


class WheelCalibration:
    """Linear model of the systematic errors of an external prior, and of the noise that remains after correction.

    If the wheels are larger than configured, measured distances are too short. Unequal wheels add a rotation. With a
    wrong mounting, the sensor seems to move sideways when the robot rotates. Ridge regression of the errors on the
    motions measured by the prior [m, m, rad] estimates all nine coefficients.

    Attributes
    ----------
    matrix : (3, 3) float
        Matrix E of the correction m_true = (I + E) m_prior for motions m, in the frame of the sensor.
    """

    def __init__(self) -> None:
        # Sums over motions m with errors e, fading with distance: m m', e m', squared normalised residuals, distance.
        self._moments, self._products = _RIDGE * np.eye(DOF), np.zeros((DOF, DOF))
        self._squared_residuals, self._distance = np.full(DOF, _INITIAL_DISTANCE), _INITIAL_DISTANCE
        self._solve()

    def _solve(self) -> None:
        """Solve the ridge regression."""
        coefficients = np.linalg.solve(self._moments, self._products).T
        self.matrix: NDArray[np.float64] = np.clip(coefficients, -_MAX_COEFFICIENT, _MAX_COEFFICIENT)
        variance_ratio = np.maximum(self._squared_residuals / self._distance, _MIN_SIGMA_RATIO ** 2)
        self._sigma_ratio: NDArray[np.float64] = np.sqrt(variance_ratio)

    def corrected(self, prior: Prior) -> Prior:
        """Remove the systematic error from the motion of a `prior`; increase its covariance to the noise observed."""
        motion, ratio = prior.transform, np.maximum(self._sigma_ratio, 1.0)
        covariance = prior.covariance * np.outer(ratio, ratio)
        return Prior(motion @ SE2.from_array(self.matrix @ motion.as_array()), covariance)

    def tightened(self, prior: Prior) -> Prior:
        """Reduce the covariance of a `corrected` prior to the noise observed so far."""
        ratio = np.minimum(self._sigma_ratio, 1.0)
        return Prior(prior.transform, prior.covariance * np.outer(ratio, ratio))

    def learn(self, prior: Prior, observed: SE2, weight: float, memory: float, supported: bool = True) -> None:
        """Update the calibration and the estimate of the noise from one motion.

        Parameters
        ----------
        prior : Prior
            Motion measured by the external source.
        observed : SE2
            The same motion estimated from the scans.
        weight : float
            Weight of this motion, from 0 to 1.
        memory : float [m]
            Distance travelled after which the weight of an earlier motion has faded to 1 / e; 1 rad counts as 1 m.
        supported : bool
            Whether both motions agree; otherwise only the noise is updated.
        """
        motion, error = prior.transform.as_array(), (prior.transform.inverse() @ observed).as_array()
        distance = math.sqrt(motion @ motion)
        fading = math.exp(-distance / memory)
        residual = error - self.matrix @ motion
        added, initial = weight * distance, (1.0 - fading) * _INITIAL_DISTANCE
        ridge = (1.0 - fading) * _RIDGE * np.eye(DOF)
        if supported:
            self._moments = fading * self._moments + weight * motion[:, None] * motion + ridge
            self._products = fading * self._products + weight * motion[:, None] * error
        # Outliers are bounded by the noise observed so far.
        squared = added * np.minimum(residual ** 2 / prior.covariance.diagonal(), (SIGMAS * self._sigma_ratio) ** 2)
        self._squared_residuals = fading * self._squared_residuals + squared + initial
        self._distance = fading * self._distance + added + initial
        self._solve()


_RIDGE = 0.1
"""Ridge term of the regression [m^2, rad^2]: it expects coefficients of about 6 % if each step has an error of 2 cm."""
_INITIAL_DISTANCE = 1.0
"""Initial estimate of the noise: as if residuals over this distance [m] had matched the covariance of the prior."""
_MAX_COEFFICIENT = 0.2
"""Largest absolute value of a coefficient: larger errors are not systematic errors of wheels."""
_MIN_SIGMA_RATIO = 0.15
"""The standard deviation of a prior is reduced to no less than this ratio of the original."""
