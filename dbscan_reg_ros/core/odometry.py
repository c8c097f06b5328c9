"""Laser odometry: keeps a reference, registers every scan to it and integrates the pose."""
import math
from collections import deque

import numpy as np

from .features import extract_features
from .parameters import Parameters
from .records import OdometryUpdate, Prior, Status
from .registration import register
from .scan import Scan
from .se2 import SE2


class Odometry:
    """Poses from a stream of scans.

    Parameters
    ----------
    parameters : Parameters
        May be replaced at any time; a new value counts from the next scan on.
    """

    def __init__(self, parameters: Parameters = Parameters()):
        self.parameters = parameters
        self.reset()

    def reset(self, pose: SE2 = SE2()):
        """Forget the reference; the next scan starts anew at `pose`."""
        self._pose = pose
        self._covariance = np.zeros((3, 3))
        self._reference = None
        self._reference_pose = pose
        self._stamp = None
        self._intervals = deque(maxlen=51)
        self._step = SE2()

    def process(self, scan: Scan, prior: Prior | None = None) -> OdometryUpdate:
        """Register `scan` and say where the sensor is.

        Raises
        ------
        ScanError
            When the scan holds too few returns to be used; the state is unchanged.
        """
        features = extract_features(scan, self.parameters)
        if self._reference is None:
            return self._start(features)
        interval = self._clean_interval(scan.stamp)
        expected = self._reference_pose.inverse() @ self._pose @ self._step
        guess = prior or Prior(expected, np.diag([0.1, 0.1, 0.05]) ** 2)
        registration = register(self._reference, features, self.parameters, guess)
        if registration.status is Status.FAILED:
            pose = self._reference_pose @ guess.transform
        else:
            pose = self._reference_pose @ registration.transform
        step = self._pose.inverse() @ pose
        covariance = registration.covariance
        self._covariance = self._covariance + covariance
        twist = step.as_array() / interval if interval > 0.0 else np.zeros(3)
        reference, reference_pose = self._reference, self._reference_pose
        moved = reference_pose.inverse() @ pose
        changed = registration.status is not Status.FAILED and (
            math.hypot(moved.x, moved.y) > 0.3 or abs(moved.theta) > 0.26)
        if changed:
            self._reference, self._reference_pose = features, pose
        self._pose, self._step, self._stamp = pose, step, scan.stamp
        return OdometryUpdate(scan.stamp, pose, self._covariance, twist, covariance / max(interval, 1e-3) ** 2, interval,
                              step, registration.status, registration, features, reference, reference_pose, changed)

    def _start(self, features):
        self._reference, self._reference_pose = features, self._pose
        self._stamp = features.scan.stamp
        return OdometryUpdate(features.scan.stamp, self._pose, np.eye(3) * 1e-9, np.zeros(3), np.eye(3) * 1e-6, 0.0, SE2(),
                              Status.OK, None, features, None, self._pose, True)

    def _clean_interval(self, stamp):
        interval = (stamp - self._stamp) * 1e-9
        if interval > 0.0:
            self._intervals.append(interval)
        median = float(np.median(self._intervals)) if self._intervals else 0.0
        return interval if 0.5 * median <= interval <= 2.0 * median else median
