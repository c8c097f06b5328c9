# SPDX-License-Identifier: Apache-2.0
"""Conversion of LaserScan messages to scans without masked beams, and warnings about the messages."""
from rclpy.clock import Clock
from sensor_msgs.msg import LaserScan

from ...core.geometry.mounting import Mounting
from ...core.scan import Scan
from ...core.scan_geometry import ScanGeometry
from ...recordings.scan_checks import ScanChecks, ScanFields, ScanWarning
from ...robot.mask import Mask
from ...robot.parameters import InputParameters
from ..throttled_log import ThrottledLog


class ScanReader:
    """Converts LaserScan messages to `Scan`, and logs warnings about the messages.

    Parameters
    ----------
    clock : rclpy.clock.Clock
        Clock that the stamps are compared with.
    log : ThrottledLog
        Log for the warnings.
    """

    def __init__(self, clock: Clock, log: ThrottledLog) -> None:
        self._clock = clock
        self._log = log
        self._checks = ScanChecks()
        self._warnings: dict[object, ScanWarning] = {}
        self._geometry: ScanGeometry | None = None
        self._mask = Mask()

    def check(self, message: LaserScan) -> list[ScanWarning]:
        """Return the warnings about a scan; log each warning once while its cause lasts."""
        found: list[ScanWarning] = self._checks.look(ScanFields.from_message(message), self._clock.now().nanoseconds)
        for warning in found:
            if self._warnings.get(warning.kind) is not warning:
                self._log.warn(warning.text)
            self._warnings[warning.kind] = warning
        return found

    def restart(self) -> None:
        """Accept any stamp of the next scan: the clock was reset."""
        self._checks.restart()

    def read(self, message: LaserScan, mounting: Mounting, parameters: InputParameters) -> Scan:
        """Convert a LaserScan message to the scan of a sensor at `mounting.aligned_pose`, without masked returns.

        Raises
        ------
        ScanError
            When the message is not a valid scan.
        """
        scan = Scan.from_message(message, self._geometry, mounting.upside_down, mounting.pose.theta)
        self._geometry = scan.geometry
        return self._mask.apply(scan, mounting, parameters)
