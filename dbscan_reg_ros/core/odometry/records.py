# SPDX-License-Identifier: Apache-2.0
"""Record of one step of the odometry."""
import math
from dataclasses import dataclass, field

import numpy as np

from ..features.records import Features
from ..geometry.se2 import DOF, SE2
from ..registration.records import Registration, Status, sigma_text
from ..sensor import FIRST, Sensor


@dataclass(frozen=True, eq=False)
class OdometryUpdate:
    """Result of `Odometry.process` for one scan.

    Attributes
    ----------
    stamp : int [ns]
        Stamp of the scan.
    pose : SE2
        Pose of the first sensor in the odometry frame, whose origin is the pose of this sensor at the first scan.
    covariance : (3, 3) float
        Covariance of `pose` for (x, y, theta) in the odometry frame [m, m, rad].
    twist : (3,) float
        Velocity (vx, vy, omega) of the first sensor, in its frame [m/s, m/s, rad/s].
    twist_covariance : (3, 3) float
        Covariance of `twist`.
    interval : float [s]
        Filtered time since the last scan of any sensor; 0 for the first.
    increment : SE2
        Motion of the first sensor since the last scan of any sensor, in its frame at the time of that scan.
    status : Status
    registration : Registration or None
        None for the first scan after a start or a reset, and for the first scan of another sensor.
    features : Features
        Features of this scan.
    reference : Features or None
        Features of the key frame that the scan was registered to.
    reference_pose : SE2
        Pose in the odometry frame of the sensor that measured `reference`, at the time of that key frame.
    is_key_frame : bool
        Whether this scan becomes a key frame.
    restarted : str
        If `registration` is None: why tracking restarted at this scan. Otherwise what is wrong with the stamp of the
        scan. Empty if there is nothing to report.
    wheel_correction : (3, 3) float
        Systematic error E of external priors, estimated by the online calibration: m_true = (I + E) m_prior, for
        motions m [m, m, rad] in the frame of the sensor. 0 while unknown.
    number : int
        Number of scans that this `Odometry` processed before this one; a reset does not set it back to 0.
    reference_number : int or None
        `number` of the scan that became the key frame `reference`.
    sensor : Sensor
        The sensor of the scan.
    joined : bool
        Whether this is the first scan of another sensor, added to a track that a first sensor started.
    repeats : bool
        Whether the scan was not used because its ranges are those of the scan before, while others are new.
    contradicted : SE2 or None
        Motion that an external prior measured instead of `increment`, and that was not used: the scan contradicts it.
    finding : str
        What the scans so far have shown about the lidar, and what to do; empty if this scan shows nothing new.
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
    is_key_frame: bool
    restarted: str = ''
    wheel_correction: np.ndarray = field(default_factory=lambda: np.zeros((DOF, DOF)))
    number: int = 0
    reference_number: int | None = None
    sensor: Sensor = FIRST
    joined: bool = False
    repeats: bool = False
    contradicted: SE2 | None = None
    finding: str = ''

    @property
    def contradicted_by(self) -> float:
        """By how much [m] the `contradicted` motion differs from `increment`; 0 without one."""
        return math.dist(self.increment.as_tuple()[:2], self.contradicted.as_tuple()[:2]) if self.contradicted else 0.0

    @property
    def contradiction(self) -> str:
        """Where and by how much the scan contradicts the wheels; empty if it does not."""
        if self.contradicted is None:
            return ''
        wheels, scans = (math.hypot(each.x, each.y) for each in (self.contradicted, self.increment))
        return (f'the wheels measured {wheels:.2f} m, the scans {scans:.2f} m, up to x {self.pose.x:.2f} m, '
                f'y {self.pose.y:.2f} m; the scans are used: check the wheels for slip and lost ticks')

    @property
    def starts_track(self) -> bool:
        """Whether a track starts with this scan."""
        return self.registration is None and self.is_key_frame and not self.joined

    @property
    def waits(self) -> bool:
        """Whether the scan was not used: the track and its time have not changed."""
        return self.registration is None and not self.is_key_frame

    @property
    def scan_pose(self) -> SE2:
        """Pose of the `sensor` of the scan, which need not be the first one, in the odometry frame."""
        return self.sensor.pose_at(self.pose)

    def __repr__(self) -> str:
        """Return one line with scan, pose, twist and status."""
        vx, vy, omega = self.twist
        marks = ', becomes a key frame' * self.is_key_frame
        marks += f', restarted: {self.restarted}' * bool(self.restarted)
        return (f'OdometryUpdate(scan {self.number} at {self.stamp} ns, {self.pose.brief()}, '
                f'{sigma_text(self.covariance, "odom")}, twist {vx:.3f} m/s, {vy:.3f} m/s, {omega:.3f} rad/s, '
                f'{self.status.name}{marks})')
