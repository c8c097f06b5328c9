# SPDX-License-Identifier: Apache-2.0
"""Conversion of messages of a lidar to scans without masked beams, and warnings about the messages."""
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock
from sensor_msgs.msg import LaserScan, PointCloud2

from ...core.geometry.mounting import Mounting
from ...core.geometry.se2 import SE2
from ...core.scan import Scan, in_nanoseconds
from ...core.scan_geometry import ScanGeometry
from ...recordings.checks.scan_checks import BETWEEN_SCANS, CloudChecks, ScanChecks, ScanFields, ScanWarning
from ...robot.mask import Mask
from ...robot.parameter_groups import InputParameters
from ...robot.point_cloud import no_points, scan_from_cloud
from ..throttled_log import ThrottledLog

ScanMessage: TypeAlias = LaserScan | PointCloud2
"""Types of the messages of a lidar."""


class MountingSource(Protocol):
    """Where the mounting of a lidar is found: `Mountings`."""

    change: str

    def ready(self, frame: str, stamp: int) -> bool:
        """Whether the mounting of the lidar `frame` at `stamp` [ns] is known, or no scan waits for it any more."""

    def find(self, frame: str, stamp: int, log: ThrottledLog) -> Mounting:
        """Return the mounting of the lidar `frame` at `stamp` [ns]."""

    def matrix(self, frame: str, stamp: int, log: ThrottledLog) -> NDArray[np.float64]:
        """Return the matrix ``(4, 4)`` from the lidar `frame` to the base frame at `stamp` [ns]."""


class ScanReader:
    """Converts messages of a lidar to `Scan`, and logs warnings about them; the `clock` is that of the stamps."""

    def __init__(self, clock: Clock, log: ThrottledLog) -> None:
        self._clock = clock
        self._log = log
        self._checks = ScanChecks()
        self._warnings: dict[object, ScanWarning] = {}
        self._geometry: ScanGeometry | None = None
        self._mask = Mask()
        self._cloud_checks, self._of_cloud = CloudChecks(), list[ScanWarning]()

    def check(self, message: ScanMessage, mixed: bool) -> list[ScanWarning]:
        """Return the warnings about a scan; log each warning once while its cause lasts.

        Scans of several publishers are `mixed`: one is not compared with the next.
        """
        found: list[ScanWarning] = self._checks.look(ScanFields.from_message(message), self._clock.now().nanoseconds)
        found = [warning for warning in found if not (mixed and warning.kind in BETWEEN_SCANS)]
        self._tell(found)
        return [*found, *self._of_cloud]

    def _tell(self, found: list[ScanWarning]) -> None:
        for warning in found:
            if self._warnings.get(warning.kind) is not warning:
                self._log.warn(warning.text)
            self._warnings[warning.kind] = warning

    def restart(self) -> None:
        """Accept any stamp of the next scan: the clock was reset."""
        self._checks.restart()

    def read(self, message: ScanMessage, mountings: MountingSource,
             parameters: InputParameters) -> tuple[Scan, Mounting]:
        """Convert a message to the scan, without masked returns, of a sensor at the `aligned_pose` of a mounting.

        Returns both. The mounting of a 3D lidar has no yaw, as its scans have the axes of the base. Raises a ScanError
        when the message is not a valid scan, and a MountingError when the mounting is not known yet, or the lidar is
        tilted.
        """
        frame, stamp = message.header.frame_id, in_nanoseconds(message.header.stamp)
        if isinstance(message, PointCloud2):
            matrix = mountings.matrix(frame, stamp, self._log)
            mounting = Mounting(SE2(float(matrix[0, 3]), float(matrix[1, 3])))
            scan = scan_from_cloud(message, matrix, parameters)
            self._of_cloud = self._cloud_checks.look(message, matrix)
            self._tell(self._of_cloud)
            if not (scan.valid.any() or self._of_cloud):
                self._log.warn(no_points(message, matrix, parameters))
            return self._masked(scan, mounting, parameters), mounting
        mounting = mountings.find(frame, stamp, self._log)
        scan = Scan.from_message(message, self._geometry, mounting.upside_down, mounting.pose.theta)
        self._geometry = scan.geometry
        return self._masked(scan, mounting, parameters), mounting

    def _masked(self, scan: Scan, mounting: Mounting, parameters: InputParameters) -> Scan:
        """Return the scan without masked returns; log once where the mask is outside of the field of view."""
        before, scan = self._mask.fault, self._mask.apply(scan, mounting, parameters)
        if self._mask.fault and self._mask.fault != before:
            self._log.warn(self._mask.fault)
        return scan
