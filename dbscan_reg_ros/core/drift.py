"""How far the odometry may be off: what the scans hold is known by them, all else by a motion that goes on as before."""
import numpy as np

from .records import Prior
from .se2 import SE2


class Drift:
    """Covariances of the errors of pose and twist, in the sensor's own frame.

    Along a direction that the scans leave free an error of the twist lasts, and that of the pose grows with it.
    """

    def __init__(self):
        # Of the pose, of the pose since the latest key frame, of the twist.
        self._joint = np.zeros((9, 9))
        self.halt()

    @property
    def pose(self):
        """(3, 3)"""
        return self._joint[:3, :3]

    @property
    def twist(self):
        """(3, 3)"""
        return self._joint[6:, 6:]

    def halt(self):
        """Know nothing of the twist."""
        self._joint[6:] = self._joint[:, 6:] = 0.0
        self._joint[6:, 6:] = np.eye(3)

    def anchor(self):
        """Take the pose as that of a key frame."""
        self._joint[3:6] = self._joint[:, 3:6] = 0.0

    def leap(self):
        """Take the pose as that of a key frame after a motion of which nothing is known."""
        self._joint[:3, :3] += np.eye(3)
        self.anchor()
        self.halt()

    def advance(self, step: SE2, interval, expected: Prior, share=np.zeros((3, 3)), matched=np.zeros((3, 3))):
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
        # The error of the step: the match takes back the one since the key frame, and the twist adds its own.
        added = np.zeros((3, 9))
        added[:, 3:6] = -share @ back
        lasting = expected.covariance
        if expected.change is not None:
            lasting = expected.change
            # No speed is expected beyond that of `halt`: old errors fade as new ones come.
            added[:, 6:] = interval * np.sqrt(np.maximum(1.0 - rate * rate * np.diagonal(lasting), 0.0)) * rest
        onward = np.concatenate((added, added, rate * added))
        onward[:3, :3] += back
        onward[3:6, 3:6] += back
        rates = np.array((1.0, 1.0, rate))
        noise = rest @ lasting @ rest.T + share @ matched @ share.T
        noise = (np.multiply.outer(rates, rates)[:, None, :, None] * noise[:, None, :]).reshape(9, 9)
        noise[:6, :6] += np.tile(rest @ (expected.covariance - lasting) @ rest.T, (2, 2))
        self._joint = onward @ self._joint @ onward.T + noise
        if not rate:
            self.halt()
