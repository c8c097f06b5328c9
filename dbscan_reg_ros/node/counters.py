# SPDX-License-Identifier: Apache-2.0
"""Counters of the scans of one lidar, and the diagnostic level and message of the latest scan (`Counters.grade`)."""
import math
from collections import Counter, deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.mounting import Mounting
from ..core.geometry.se2 import SE2
from ..core.odometry.calibration.compared_lidar import ComparedLidar
from ..core.odometry.records import OdometryUpdate
from ..core.odometry.verdict import LIMITS
from ..core.registration.records import Status
from ..recordings.checks.scan_checks import Kind, ScanWarning
from ..robot.own_body import OwnBody

TIMED_SCANS = 200
"""Number of the latest scans whose processing times are kept."""


class Grade(IntEnum):
    """Quality of the tracking, in increasing order of severity."""

    TRACKING = 0
    LOW_CONFIDENCE = 1
    LOST = 2


@dataclass
class Counters:
    """Scans of one lidar since the node started by number, result of the latest, and warnings not reported yet."""

    processed: int = 0
    skipped: int = 0
    """Number of scans processed and skipped so far."""
    statuses: Counter[Status] = field(default_factory=Counter)
    """Number of scans with each `Status`."""
    too_fast: int = 0
    """Number of scans rejected so far because `odometry.max_speed` or `odometry.max_turn_rate` was exceeded."""
    durations: deque[float] = field(default_factory=lambda: deque(maxlen=TIMED_SCANS))
    """Processing times of the last `TIMED_SCANS` scans [s]."""
    update: OdometryUpdate | None = None
    """Result of the latest processed scan."""
    degenerate_direction: float | None = None
    """Direction [rad] in `odom_frame` along which the latest scan does not constrain the pose; None if it constrains
    every direction."""
    sensor_pose: SE2 = field(default_factory=SE2)
    """Pose of the sensor in the base frame at the latest scan: `Mounting.aligned_pose`."""
    compared: ComparedLidar | None = None
    """Comparisons of this lidar with the first one."""
    mounting: Mounting = field(default_factory=Mounting)
    """Mounting of the lidar at the latest scan."""
    body: OwnBody = field(default_factory=OwnBody)
    """Where the lidar sees the robot itself."""
    skip_reason: str = ''
    """Why the latest scan was skipped; empty when it was processed."""
    cause: str = ''
    """What is wrong with the latest scan, if that explains why it is not registered; else empty."""
    warnings: dict[Kind, str] = field(default_factory=dict)
    """Warnings about scans since the last diagnostics report: kind -> text."""

    def processed_scan(self, update: OdometryUpdate, origin: SE2, sensor_pose: SE2, duration: float) -> None:
        """Count a processed scan, its result, its `duration` [s] and the `sensor_pose`, `Mounting.aligned_pose`.

        `origin` is the pose, in `odom_frame`, of the frame in which `update` expresses poses.
        """
        self.processed += 1
        self.statuses[update.status] += 1
        if update.registration and update.status is Status.FAILED:
            self.too_fast += any(limit.value in update.registration.reason for limit in LIMITS)
        self.durations.append(duration)
        self.update = update
        if update.finding:
            self.add_warnings([ScanWarning(Kind.TIME_INCREMENT, update.finding)])
        self.skip_reason = ''
        self.sensor_pose = sensor_pose
        self.degenerate_direction = None
        if update.registration and update.registration.degenerate_direction is not None:
            reference = origin @ update.reference_pose
            self.degenerate_direction = reference.theta + update.registration.degenerate_direction

    @property
    def wheel_correction(self) -> NDArray[np.float64] | None:
        """Estimated correction ``(3, 3)`` of wheel odometry in the base frame; None if no correction is estimated."""
        if not self.update or not self.update.wheel_correction.any():
            return None
        pose = self.sensor_pose
        correction: NDArray[np.float64] = pose.adjoint() @ self.update.wheel_correction @ pose.inverse().adjoint()
        return correction

    def skip(self, reason: str) -> None:
        """Count a scan that was not processed."""
        self.skipped += 1
        self.skip_reason = reason

    def add_warnings(self, warnings: Iterable[ScanWarning]) -> None:
        """Store the warnings about a scan for the next diagnostics report."""
        self.warnings.update((warning.kind, warning.text) for warning in warnings)

    def take_warnings(self) -> list[str]:
        """Return the warnings about scans since the last call, and clear them."""
        texts, self.warnings = list(self.warnings.values()), {}
        return texts

    def grade(self) -> tuple[Grade, str]:
        """Return grade and message of the latest scan; requires that a scan was processed or skipped."""
        if self.skip_reason or self.update is None:
            return Grade.LOST, self.skip_reason
        reason = self.cause or (self.update.registration.reason if self.update.registration else '')
        status = self.update.status
        if status is Status.FAILED:
            return Grade.LOST, f'lost: {reason}' if reason else 'lost'
        if status is Status.DEGENERATE:
            return Grade.LOW_CONFIDENCE, f'degenerate{self._along()}: {reason}'
        if status is Status.AMBIGUOUS:
            return Grade.LOW_CONFIDENCE, f'ambiguous: {reason}'
        return Grade.TRACKING, 'tracking'

    def _along(self) -> str:
        """Return the degenerate direction as text; empty if only the heading is unobservable."""
        if self.degenerate_direction is None:
            return ''
        degrees = math.degrees(math.remainder(self.degenerate_direction, math.pi))
        return f', along {degrees:.0f} deg in the odometry frame'
