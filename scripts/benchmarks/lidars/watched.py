# SPDX-License-Identifier: Apache-2.0
"""Comparisons of lidars that keep what the benchmarks judge."""
import math

from dbscan_reg_ros.core.geometry.se2 import SE2
from dbscan_reg_ros.core.odometry.calibration.comparisons import LidarComparisons
from dbscan_reg_ros.core.odometry.calibration.odd_one import named


class Watched(LidarComparisons):
    """Comparisons that keep when a lidar was named first, and how many scans of the further lidars were not used.

    Attributes
    ----------
    names : int
        Number of lidars that were named then: 0, 1 or, of two, both.
    named_m : float
        Distance driven until then [m]; NaN if none was named.
    text : str
        Why, with that distance; empty if none was named.
    """

    def __init__(self) -> None:
        super().__init__()
        self.names, self.named_m, self.text, self._left_out, self._judged = 0, math.nan, '', 0, 0

    def uses(self, sensor, stamp, first_maps):
        """Whether the scan of a `sensor` may change the track; counted once the lidar is known."""
        uses = super().uses(sensor, stamp, first_maps)
        lidar = self.lidars.get(sensor.name)
        if lidar is not None and lidar.known:
            self._judged += 1
            self._left_out += not uses
        return uses

    def add(self, update, locate):
        """Add the `update` of a scan."""
        super().add(update, locate)
        for lidar in () if self.names else self.lidars.values():
            if lidar.disagrees or lidar.unfit:
                texts = [str(each) for each in named(SE2(), list(self.lidars.values())) if each]
                self.names, self.named_m = max(len(texts), 1), lidar.driven
                self.text = f'{"; ".join(texts) or "unfit"}, after {lidar.driven:.0f} m'

    @property
    def unused(self) -> float:
        """Fraction of the scans of known lidars that were not used."""
        return self._left_out / max(self._judged, 1)
