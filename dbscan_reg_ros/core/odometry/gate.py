# SPDX-License-Identifier: Apache-2.0
"""The gate: the only place that decides whether the result of a registration is believed."""
import math
from enum import Enum
from typing import NamedTuple

import numpy as np

from ..geometry.se2 import SE2
from ..geometry.symmetric_matrix import inverse, mahalanobis
from ..parameters.tree import Parameters
from ..registration.records import Prior, Registration, Status
from ..registration.status import demoted_if_weak, observability_ratio
from .models.motion import unknown_motion_covariance
from .models.wheel_calibration import WheelCalibration
from .prediction import Predictions
from .state import Tracking


class Decision(Enum):
    """What becomes of a result."""

    ACCEPT = 'accept'
    """It is believed."""
    TENTATIVE = 'tentative'
    """It is believed unless a further reference gives one that is accepted."""
    REJECT = 'reject'
    """It is not believed."""


class Verdict(NamedTuple):
    """A decision of the gate.

    Attributes
    ----------
    decision : Decision
    reason : str
        Why, in a few words.
    outlier : bool
        The result lies outside every gate. Accepted, it is a jump; rejected, the next scan may confirm it.
    """

    decision: Decision
    reason: str
    outlier: bool = False


class Gate:
    """Mahalanobis gates around the predictions for one scan.

    Parameters
    ----------
    predictions : Predictions
    tracking : Tracking
        The state after the last scan.
    parameters : Parameters
    """

    def __init__(self, predictions: Predictions, tracking: Tracking, parameters: Parameters):
        self._predictions, self._tracking, self._parameters = predictions, tracking, parameters
        best, motion, p = predictions.best, predictions.motion, parameters
        self._weak_prior = (best.prior.translation_sigma > p.decision.weak_prior_sigma
                            or p.prior.gate * best.prior.rotation_sigma > _QUARTER_TURN)
        self._wheels_slip = predictions.external is not None and not self._within(best.pose, motion.pose, motion.prior.covariance)

    def check(self, pose: SE2, registration: Registration, has_tentative: bool) -> Verdict:
        """Decide whether a scan lies at `pose` (odometry frame), as a `registration` says.

        Parameters
        ----------
        pose : SE2
        registration : Registration
        has_tentative : bool
            Whether the result for another reference is tentative already.
        """
        ok = registration.status is Status.OK
        if registration.status is Status.FAILED:
            return Verdict(Decision.REJECT, registration.reason)
        if self._near_prediction(pose, registration):
            if registration.degenerate_direction is None and (ok or not has_tentative):
                return Verdict(Decision.ACCEPT, 'within the gate')
            return Verdict(Decision.TENTATIVE, 'within the gate, but a direction is degenerate or a rival is near')
        if not (ok and self._is_trusted(registration)) or has_tentative:
            return Verdict(Decision.REJECT, 'outside the gate and not OK, or contradicted by another reference')
        motion, unconfirmed = self._predictions.motion, self._tracking.unconfirmed
        if self._within(pose, motion.pose, unknown_motion_covariance(self._predictions.interval, self._parameters)):
            return Verdict(Decision.ACCEPT, 'outside the gate, but within what an unknown motion allows', outlier=True)
        if unconfirmed is not None and self._within(pose, unconfirmed @ motion.prior.transform, motion.prior.covariance):
            return Verdict(Decision.ACCEPT, 'outside the gate, confirmed by two scans', outlier=True)
        return Verdict(Decision.REJECT, 'outside every gate; the next scan may confirm it', outlier=True)

    def asks_for_search_within(self, pose: SE2, registration: Registration) -> bool:
        """Whether an ambiguous or degenerate result outside the gates calls for the best one inside: corridors are symmetric."""
        best, motion = self._predictions.best, self._predictions.motion
        return (registration.status not in (Status.OK, Status.FAILED)
                and best.prior.translation_sigma < self._parameters.odometry.dynamic_margin and not self._tracking.lost_time
                and not self._within(pose, best.pose, best.gate_covariance)
                and not self._within(pose, motion.pose, motion.gate_covariance))

    def used_prior(self, pose: SE2, wheels: WheelCalibration) -> Prior:
        """The best prior, as precise as the wheels have proved where a match at `pose` agrees with that."""
        best = self._predictions.best
        if self._predictions.external is None:
            return best.prior
        tightened = wheels.tightened(best.prior)
        return tightened if self._within(pose, best.pose, tightened.covariance) else best.prior

    def prior_information(self, pose: SE2, prior: Prior):
        """``(3, 3)`` information of a `prior` in the frame of the scan; zero where a match at `pose` contradicts it."""
        if self._within(pose, self._predictions.best.pose, prior.covariance):
            return inverse(prior.covariance)
        return np.zeros((3, 3))

    def supports_external(self, pose: SE2) -> bool:
        """Whether the final `pose` of a scan agrees with the external prior, so that its errors can be learned."""
        external = self._predictions.external
        return (external is not None and not self._predictions.interval.gap
                and self._within(pose, self._predictions.best.pose, external.covariance))

    def starts_in_motion(self, pose: SE2, registration: Registration, start: SE2) -> bool:
        """Whether the second scan of a track, found at `pose`, proves a motion since the `start`."""
        interval = self._predictions.interval
        if registration.status is not Status.OK or interval.gap or interval.length <= 0.0:
            return False
        return _squared_distance(pose, start, registration.covariance) > self._parameters.odometry.zero_velocity_gate ** 2

    def demoted(self, registration: Registration) -> Registration:
        """The registration, no longer ``OK`` where few points constrain a motion of which nothing was known before."""
        return demoted_if_weak(registration, self._predictions.best.prior, self._parameters.decision)

    def _near_prediction(self, pose, registration):
        """Whether `pose` is within the gate of the best prediction, or of the motion model.

        Corridors are symmetric: after a weak prediction a result that is not ``OK`` has to lie within 0.7 of the gate. Few
        points do not override wheels, unless these seem to slip.
        """
        best, motion = self._predictions.best, self._predictions.motion
        ratio = _WEAK_PRIOR_GATE if self._weak_prior and registration.status is not Status.OK else 1.0
        if self._within(pose, best.pose, best.gate_covariance, ratio):
            return True
        trusted = self._is_trusted(registration)
        if not (trusted or self._wheels_slip):
            return False
        return self._within(pose, motion.pose, motion.gate_covariance if trusted else motion.prior.covariance, ratio)

    def _is_trusted(self, registration):
        """Whether a result may override the external prior: nobody has given one, or many points constrain the motion."""
        p = self._parameters
        return (self._predictions.external is None or observability_ratio(registration, p.decision) == 1.0
                or self._tracking.lost_time > p.odometry.coast_time)

    def _within(self, pose, predicted, covariance, ratio=1.0):
        """Whether `pose` lies within a `ratio` of `prior.gate` of a `predicted` pose."""
        return _squared_distance(pose, predicted, covariance) <= (ratio * self._parameters.prior.gate) ** 2


def _squared_distance(pose, reference, covariance):
    """Squared Mahalanobis distance of `pose` from a `reference` pose, in the frame of the reference."""
    return mahalanobis((reference.inverse() @ pose).as_array(), covariance)


_QUARTER_TURN = 0.5 * math.pi
"""A prior that allows for a rotation this large [rad] is weak."""
_WEAK_PRIOR_GATE = 0.7
"""Ratio of `prior.gate` within which a result that is not ``OK`` is accepted after a weak prior."""
