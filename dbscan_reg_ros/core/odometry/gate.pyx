# SPDX-License-Identifier: Apache-2.0
# cython: language_level=3, binding=True, cdivision=True
"""Mahalanobis gate: decides whether the result of a registration is accepted."""
import dataclasses
import math

import numpy as np

from ..geometry.se2 import DOF, RIGHT_ANGLE
from ..geometry.symmetric_matrix import IDENTITY, inverse, mahalanobis
from ..geometry.tolerance import SIGMAS, TINY
from ..registration.confidence.model import LIKELY
from ..registration.records import Status
from ..registration.status import WEAK_PRIOR_SIGMA, demoted_if_weak, observability_ratio
from ..sensor import FIRST
from .models.unobserved_motion import unknown_motion_covariance
from .state import Mode
from .verdict import Decision, Reason, Verdict

from ..geometry.se2 cimport SE2

cdef:
    # A degenerate result can replace another one only if it is constrained by at least this fraction of its points.
    double INFORMATION_RATIO = 0.5
    # Below this confidence a result without a prediction is right less often than a weak prediction.
    double GUESS_CONFIDENCE = 0.01
    # Least time [s] for which a difference between motion and prediction is allowed.
    double MIN_TIME = 0.01
    # A result outside the gates has to reach at least this ratio of the last score, if that is recent.
    double RECENT_SCORE_RATIO = 0.55
    # Ratio of `prior.gate` within which a result that is not ``OK`` is accepted after a weak prior.
    double WEAK_PRIOR_RATIO = 0.7


cdef class Gate:
    """Mahalanobis gates around the predictions for one scan.

    Parameters
    ----------
    predictions : Predictions
        Predictions for the first sensor.
    tracking : Tracking
        The state after the last scan.
    parameters : Parameters
    sensor : Sensor
        Sensor of the scan. All poses and covariances that the gate compares are those of this sensor.

    Attributes
    ----------
    predictions : Predictions
        Predictions for the `sensor` of the scan.
    weak_prior : bool
        Whether the best prediction is too uncertain to distinguish repeated structures.
    """

    cdef readonly object predictions, sensor
    cdef readonly bint weak_prior
    cdef object _given, _tracking, _parameters, _found
    cdef double _time_since_found

    def __init__(self, predictions, tracking, parameters, sensor=FIRST):
        self._given, predictions = predictions, predictions.of(sensor)
        self.predictions, self._tracking, self._parameters, self.sensor = predictions, tracking, parameters, sensor
        self._found = tracking.found and sensor.pose_at(tracking.found)
        best, p = predictions.best, parameters
        self.weak_prior = (best.prior.translation_sigma > WEAK_PRIOR_SIGMA
                            or p.prior.gate * best.prior.rotation_sigma > RIGHT_ANGLE)
        interval = predictions.interval
        self._time_since_found = tracking.lost_time + max(interval.length, interval.elapsed)

    def without_wheels(self):
        """Return the gate by the motion model alone if `prior.acceleration` does not explain the wheels; else None."""
        given, change = self._given, self._given.motion.prior.velocity_change
        if given.external is None or change is None or squared_distance(
                given.best.pose, given.motion.pose, given.best.prior.covariance + change) < SIGMAS ** 2:
            return None
        alone = dataclasses.replace(given, best=given.motion, external=None, contradicted=given.external)
        return Gate(alone, self._tracking, self._parameters, self.sensor)

    def after(self, interval):
        """Return the same gate with another `interval` since the last scan."""
        given = dataclasses.replace(self._given, interval=interval)
        return Gate(given, self._tracking, self._parameters, self.sensor)

    def check(self, pose, registration, has_tentative=False):
        """Decide whether the result of a registration is accepted.

        Parameters
        ----------
        pose : SE2
            Pose of the scan in the odometry frame that follows from the result.
        registration : Registration
            The result.
        has_tentative : bool
            Whether the registration to another reference gave a tentative result.
        """
        ok = registration.status is Status.OK
        if registration.status is Status.FAILED:
            return Verdict(Decision.REJECT, Reason.FAILED)
        excess = self._exceeded_limit(self._found, pose, self._time_since_found)
        if excess is not None:
            return Verdict(Decision.REJECT, excess)
        if self._near_prediction(pose, registration):
            if registration.degenerate_direction is None and (ok or not has_tentative):
                return Verdict(Decision.ACCEPT, Reason.WITHIN_GATE)
            return Verdict(Decision.TENTATIVE, Reason.INCONCLUSIVE)
        if ok and not has_tentative and self._is_reliable(registration):
            return self._check_outlier(pose, registration.score)
        return Verdict(Decision.REJECT, Reason.UNRELIABLE)

    def check_scan_before(self, before, pose, registration, alternative=None):
        """Decide on a scan registered without a prediction to the previous scan, whose pose is `before`.

        If the prediction is weak, this result may replace the `alternative`, a result that depends on the prediction.
        """
        excess = self._exceeded_limit(before, pose, self._time_since_found - self._tracking.lost_time)
        if excess is not None:
            return Verdict(Decision.REJECT, excess)
        if registration.status is not Status.OK or not self._is_reliable(registration):
            if self._is_likely(pose, registration, alternative):
                return Verdict(Decision.ACCEPT, Reason.SCAN_BEFORE)
            if self.weak_prior and self.predictions.by_motion_model and registration.confidence > GUESS_CONFIDENCE:
                return Verdict(Decision.REJECT, Reason.GUESS)
            failed = registration.status is Status.FAILED
            return Verdict(Decision.REJECT, Reason.FAILED if failed else Reason.UNRELIABLE)
        if self._scores_poorly(registration.score):
            return Verdict(Decision.REJECT, Reason.POOR_SCORE)
        return Verdict(Decision.ACCEPT, Reason.SCAN_BEFORE)

    cdef bint _is_likely(self, pose, registration, alternative):
        """Whether a result without a prediction is more likely than the `alternative`, if there is one.

        The confidence of a degenerate result does not cover the degenerate direction. Such a result needs an
        alternative: one of less confidence, or one that is degenerate too, of which at most twice as many points
        constrain that direction.
        """
        if (registration.status is Status.FAILED or not (self.weak_prior and self.predictions.by_motion_model)
                or not self._near_prediction(pose, registration)):
            return False
        degenerate = registration.status is Status.DEGENERATE
        if registration.confidence <= LIKELY:
            return False
        if alternative is None:
            return not degenerate
        if alternative.status is not Status.DEGENERATE:
            return registration.confidence > alternative.confidence
        least = INFORMATION_RATIO * (alternative.weakest_information or 0.0) - TINY
        return not degenerate or (registration.weakest_information or 0.0) >= least

    def check_lost_map(self, expected, covariance, pose, registration):
        """Decide on a scan registered to the map before a loss; its `expected` pose has a `covariance` ``(3, 3)``."""
        if registration.status is not Status.OK:
            return Verdict(Decision.REJECT, Reason.FAILED)
        if not self._within(pose, expected, covariance):
            return Verdict(Decision.REJECT, Reason.UNRELIABLE)
        return Verdict(Decision.ACCEPT, Reason.REJOINED)

    cdef _exceeded_limit(self, SE2 found, SE2 pose, double time):
        """Return which limit (speed or turn rate) is exceeded by the motion from `found` to `pose` in a `time` [s]."""
        p, time = self._parameters, max(time, self.predictions.unconstrained_time)
        if found is None or time <= 0.0:
            return None
        motion = found.inverse() @ pose
        if math.hypot(motion.x, motion.y) > p.odometry.max_speed * time + self._gate_at_rest():
            return Reason.TOO_FAST
        limit = p.odometry.max_turn_rate * time + self._gate_at_rest()
        return Reason.TURNS_TOO_FAST if abs(motion.theta) > limit else None

    cdef double _gate_at_rest(self):
        """Return the gate [m] or [rad] around the prediction for a sensor at rest."""
        return self._parameters.prior.gate * self._parameters.prior.min_sigma

    cdef bint _scores_poorly(self, score):
        """Whether `score` is much lower than that of the last registered scan; less strict the older that scan is."""
        recent = max(1.0 - self._time_since_found / max(self._parameters.odometry.coast_time, TINY), 0.0)
        return score < RECENT_SCORE_RATIO * recent * self._tracking.score

    cdef _check_outlier(self, pose, score):
        """Decide whether a reliable result outside the gates is accepted; the pose then jumps."""
        if self._scores_poorly(score):
            return Verdict(Decision.REJECT, Reason.POOR_SCORE)
        unknown = unknown_motion_covariance(self.predictions.interval, self._parameters)
        if self._within(pose, self.predictions.motion.pose, unknown) and not self._leaps(pose):
            return Verdict(Decision.ACCEPT, Reason.UNKNOWN_MOTION)
        return Verdict(Decision.REJECT, Reason.OUTSIDE)

    def asks_for_search_within(self, pose, registration):
        """Whether to search again inside the gate, as the result is not ``OK`` and outside it (symmetric corridors)."""
        best = self.predictions.best
        return (registration.status not in (Status.OK, Status.FAILED)
                and best.prior.translation_sigma < self._parameters.odometry.dynamic_margin
                and not self._tracking.lost_time
                and not self._within(pose, best.pose, best.gate_covariance))

    def used_prior(self, pose, wheels):
        """Return the best prior, with the covariance reduced by the wheel calibration if a match at `pose` fits it."""
        best = self.predictions.best
        if self.predictions.external is None:
            return best.prior
        tightened = self.sensor.prior_of(wheels.tightened(self.sensor.first_prior(best.prior)))
        return tightened if self._within(pose, best.pose, tightened.covariance) else best.prior

    def prior_information(self, pose, prior):
        """Return the information ``(3, 3)`` of a `prior`; 0 if a match at `pose` contradicts the prior."""
        if self._within(pose, self.predictions.best.pose, prior.covariance):
            return inverse(prior.covariance)
        return np.zeros((DOF, DOF))

    def motion_information(self, prior):
        """Return the information ``(3, 3)`` of a motion that differs from the `prior` by about 1 m/s and 1 rad/s."""
        return inverse(prior.covariance + max(self._time_since_found, MIN_TIME) ** 2 * IDENTITY)

    def supports_external(self, pose):
        """Whether the final `pose` of a scan agrees with the external prior, so that its errors can be estimated."""
        external = self.predictions.external
        return (external is not None and not self.predictions.interval.gap
                and self._within(pose, self.predictions.best.pose, external.covariance))

    def starts_in_motion(self, pose, registration, start):
        """Whether the second scan of a track, found at `pose`, proves a motion since the `start`."""
        interval = self.predictions.interval
        if registration.status is not Status.OK or interval.gap or interval.length <= 0.0:
            return False
        gate = self._parameters.odometry.zero_velocity_gate
        return squared_distance(pose, start, registration.covariance) > gate ** 2

    def is_correction(self, pose, verdict):
        """Whether the displacement to a result is no motion, but the correction of a wrong or merely predicted pose.

        This holds for a scan registered to the map before a loss, for an outlier after a loss, and for a result that
        differs from a reliable prediction by more than 1 m/s.
        """
        reason = verdict.reason
        if reason is Reason.REJOINED or (reason is Reason.UNKNOWN_MOTION and self._tracking.lost_time > 0.0):
            return True
        return reason is not Reason.WITHIN_GATE and self._leaps(pose)

    cdef bint _leaps(self, SE2 pose):
        """Whether a result differs from a prediction that is not weak by more than 1 m/s.

        Scans of different sensors may have the same stamp: there the gate of a prediction without motion is allowed.
        """
        if self.weak_prior or self._tracking.mode is Mode.STARTING:
            return False
        change = self.predictions.best.pose.inverse() @ pose
        allowed = self._gate_at_rest() if self.predictions.interval.of_others else 0.0
        return math.hypot(change.x, change.y) > max(self._time_since_found, allowed)

    def demoted(self, pose, registration, verdict, chained):
        """Return the registration with its status lowered from ``OK`` if pose or motion are not reliable.

        The status is lowered in three cases: few points constrain the motion and the prediction is weak; the result is
        a correction; the scans since a loss or a gap have not been found in the map before it yet (`chained`: why).
        """
        registration = demoted_if_weak(registration, self.predictions.best.prior, self._parameters.decision)
        if registration.status is not Status.OK or not (chained or self.is_correction(pose, verdict)):
            return registration
        reason = chained or verdict.reason
        return dataclasses.replace(registration, status=Status.AMBIGUOUS, reason=reason.value)

    cdef bint _near_prediction(self, pose, registration):
        """Whether `pose` is within the gate around the best prediction.

        Corridors are symmetric: after a weak prior, a result that is not ``OK`` has to lie within 0.7 of the gate.
        """
        best = self.predictions.best
        ratio = WEAK_PRIOR_RATIO if self.weak_prior and registration.status is not Status.OK else 1.0
        return self._within(pose, best.pose, best.gate_covariance, ratio)

    cdef bint _is_reliable(self, registration):
        """Whether a result may override the prediction.

        It may if many points constrain the result, if there is no external prior, or if tracking has been lost for
        longer than `odometry.coast_time`.
        """
        p = self._parameters
        return (self.predictions.external is None or observability_ratio(registration, p.decision) == 1.0
                or self._tracking.lost_time > p.odometry.coast_time)

    cdef bint _within(self, SE2 pose, SE2 predicted, covariance, double ratio=1.0):
        """Whether the Mahalanobis distance of `pose` from a `predicted` pose is at most a `ratio` of `prior.gate`."""
        return squared_distance(pose, predicted, covariance) <= (ratio * self._parameters.prior.gate) ** 2


cdef double squared_distance(SE2 pose, SE2 reference, covariance):
    """Return the squared Mahalanobis distance of `pose` from a `reference` pose, in the frame of the reference."""
    cdef SE2 offset = reference.inverse() @ pose
    return mahalanobis((offset.x, offset.y, offset.theta), covariance)
