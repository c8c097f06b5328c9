# SPDX-License-Identifier: Apache-2.0
"""Conversion of LaserScan messages to scans without masked beams, and warnings about the messages."""
import math

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock
from sensor_msgs.msg import LaserScan

from ...core.geometry.mounting import Mounting
from ...core.scan import Scan
from ...core.scan_geometry import ScanGeometry
from ...recordings.scan_checks import ScanChecks, ScanFields, ScanWarning
from ...robot.parameters import NodeParameters
from ..throttled_log import ThrottledLog

BEARING_TOLERANCE = 1e-6
"""Tolerance [rad] for rounded bearings at the border of a masked sector."""


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
        self._mask: tuple[object, NDArray[np.bool_]] | None = None

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

    def read(self, message: LaserScan, mounting: Mounting, parameters: NodeParameters) -> Scan:
        """Convert a message to the scan of a sensor at `mounting.aligned_pose`, without the returns in ``input.mask``.

        Raises
        ------
        ScanError
            When the message is not a valid scan.
        """
        scan = Scan.from_message(message, self._geometry, mounting.upside_down, mounting.pose.theta)
        if scan.geometry is not self._geometry:
            self._geometry, self._mask = scan.geometry, None
        return self._without_masked(scan, mounting, parameters)

    def _without_masked(self, scan: Scan, mounting: Mounting, parameters: NodeParameters) -> Scan:
        limit = parameters.input.mask_range
        masked = self._in_sectors(scan, mounting, parameters)
        if limit > 0.0:
            masked = masked & (scan.ranges < limit)
        if not masked.any():
            return scan
        return Scan(scan.stamp, np.where(masked, np.float32(np.nan), scan.ranges), scan.geometry, scan.time_increment,
                    scan.frame_id)

    def _in_sectors(self, scan: Scan, mounting: Mounting, parameters: NodeParameters) -> NDArray[np.bool_]:
        """Return which beams ``(N,)`` lie in a sector of ``input.mask``; cached until parameters or mounting change."""
        key = parameters.input.mask, mounting
        if self._mask is None or self._mask[0] != key:
            sectors = np.reshape(parameters.input.mask, (-1, 2))
            sectors = sectors[sectors[:, 0] != sectors[:, 1]]
            bearings = scan.geometry.bearings - mounting.pose.theta
            self._mask = key, within(-bearings if mounting.upside_down else bearings, sectors)
        return self._mask[1]


def within(bearings: NDArray[np.float64], sectors: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which bearings lie in at least one of the sectors.

    Parameters
    ----------
    bearings : (N,) float
        [rad]
    sectors : (M, 2) float
        First and last bearing of each sector, counter-clockwise [rad].

    Returns
    -------
    (N,) bool
    """
    full = 2.0 * math.pi
    widths = np.remainder(sectors[:, 1] - sectors[:, 0], full)
    widths[widths == 0.0] = full
    offsets = np.remainder(bearings[:, None] - sectors[:, 0], full)
    return np.asarray((offsets <= widths + BEARING_TOLERANCE).any(axis=1))
