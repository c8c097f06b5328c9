# SPDX-License-Identifier: Apache-2.0
"""Record of one step of the odometry."""
from dataclasses import dataclass, field

import numpy as np

from ..features.records import Features
from ..geometry.se2 import SE2
from ..registration.records import Registration, Status, sigma_text


@dataclass(frozen=True, eq=False)
class OdometryUpdate:
    """What `Odometry.process` says of one scan.

    Attributes
    ----------
    stamp : int
        The scan's own stamp [ns].
    pose : SE2
        Pose of the sensor in the odometry frame (that of the first scan).
    covariance : (3, 3) float
        Of `pose`, for (x, y, theta) in the odometry frame, m, m, rad.
    twist : (3,) float
        Velocity (vx, vy, omega) in the sensor's frame, m/s, m/s, rad/s.
    twist_covariance : (3, 3) float
    interval : float
        The cleaned time since the last scan [s]; 0 for the first.
    increment : SE2
        Motion since the last scan, in the last scan's frame.
    status : Status
    registration : Registration or None
        None for the first scan after a start or a reset.
    features : Features
        Of this scan.
    reference : Features or None
        What it was registered to.
    reference_pose : SE2
        Pose of `reference` in the odometry frame.
    reference_changed : bool
        This scan becomes the reference (or part of it) for those that follow.
    restarted : str
        Why tracking restarted at this scan, without a `registration`; with one, what is wrong with its stamp; else empty.
    wheel_correction : (3, 3) float
        What is known to be wrong with told motions: one told as m [m, m, rad] was m + `wheel_correction` @ m, in the sensor's frame. 0
        as long as nothing is known.
    number : int
        How many scans this `Odometry` used before this one, resets included.
    reference_number : int or None
        `number` of the scan of `reference`, whose features may have been made anew since.
    """

    stamp: int
    pose: SE2
    covariance: np.ndarray
    twist: np.ndarray
    twist_covariance: np.ndarray
    interval: float
    increment: SE2
    status: Status
    registration: Registration | None
    features: Features
    reference: Features | None
    reference_pose: SE2
    reference_changed: bool
    restarted: str = ''
    wheel_correction: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    number: int = 0
    reference_number: int | None = None

    def __repr__(self) -> str:
        vx, vy, omega = self.twist
        marks = ', becomes a reference' * self.reference_changed + f', restarted: {self.restarted}' * bool(self.restarted)
        return (f'OdometryUpdate(scan {self.number} at {self.stamp} ns, {self.pose.brief()}, {sigma_text(self.covariance)}, '
                f'twist {vx:.3f} m/s, {vy:.3f} m/s, {omega:.3f} rad/s, {self.status.name}{marks})')
