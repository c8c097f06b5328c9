# SPDX-License-Identifier: Apache-2.0
"""How far the odometry may be off: what the scans hold is known by them, all else by a motion that goes on as before."""
import numpy as np

from ...geometry.se2 import SE2
from ...registration.records import Prior


class CovariancePropagation:
    """Covariances of the errors of pose and twist, in the sensor's own frame.

    Along a direction that the scans leave free an error of the twist lasts, and that of the pose grows with it.
    """

    def __init__(self):
        # Of the pose, of the pose since the latest key frame, of the twist.
        self._joint = np.zeros((9, 9))
        self.reset_twist()

    @property
    def pose(self):
        """(3, 3)"""
        return self._joint[:3, :3]

    @property
    def twist(self):
        """(3, 3)"""
        return self._joint[6:, 6:]

    def reset_twist(self):
        """Know nothing of the twist."""
        self._joint[6:] = self._joint[:, 6:] = 0.0
        self._joint[6:, 6:] = np.eye(3)

    def reduce_heading_variance(self, share):
        """Know the heading better: its standard deviation is only a `share` of what it was."""
        self._joint[2] *= share
        self._joint[:, 2] *= share

    def start_key_frame(self):
        """Take the pose as that of a key frame."""
        self._joint[3:6] = self._joint[:, 3:6] = 0.0

    def add_unknown_motion(self):
        """Take the pose as that of a key frame after a motion of which nothing is known."""
        self._joint[:3, :3] += np.eye(3)
        self.start_key_frame()
        self.reset_twist()

    def propagate(self, step: SE2, interval, expected: Prior, share=np.zeros((3, 3)), matched=np.zeros((3, 3))):
        """Go on by a `step`.

        The new pose is ``share`` of where the key frames have it and the rest of where it was expected.

        Parameters
        ----------
        step : SE2
        interval : float [s]
        expected : Prior
        share, matched : (3, 3) arrays
            The covariance `matched` is that of the scan's place among the key frames, in its own frame.
        """
        rate = 1.0 / interval if interval > 0.0 else 0.0
        rest, back = np.eye(3) - share, step.inverse().adjoint()
        # Six independent errors: the three of the joint, the change of the twist, the rest of the expected step, the match.
        errors = np.zeros((18, 18))
        errors[:9, :9] = self._joint
        change = expected.covariance if expected.velocity_change is None else expected.velocity_change
        errors[9:12, 9:12] = change
        errors[12:15, 12:15] = expected.covariance - change
        errors[15:, 15:] = matched
        # What they make of the error of the step: the match takes back the one since the key frame.
        added = np.zeros((3, 18))
        added[:, 3:6] = -share @ back
        added[:, 9:12] = added[:, 12:15] = rest
        added[:, 15:] = share
        if expected.velocity_change is not None:
            # No speed is expected beyond that of `reset_twist`: old errors fade as new ones come.
            added[:, 6:9] = interval * np.sqrt(np.maximum(1.0 - rate * rate * change.diagonal(), 0.0)) * rest
        onward = np.concatenate((added, added, rate * added))
        onward[:3, :3] += back
        onward[3:6, 3:6] += back
        onward[6:, 12:15] = 0.0
        self._joint = onward @ errors @ onward.T
        if not rate:
            self.reset_twist()
