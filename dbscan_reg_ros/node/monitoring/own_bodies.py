# SPDX-License-Identifier: Apache-2.0
"""Lidars that see the robot itself: named on /diagnostics, and once in the log with the mask to set."""
from collections.abc import Iterator, Sequence

from ...robot.own_body import advice, described
from ..interfaces.lidar import Lidar


class OwnBodies:
    """Describes for each lidar where it sees the robot itself."""

    def __init__(self) -> None:
        self._logged: dict[str, int] = {}

    def found(self, lidars: Sequence[Lidar]) -> Iterator[str]:
        """Yield a sentence for each lidar that sees the robot; log it when there are more sectors, with what to do."""
        for lidar in lidars:
            sectors = [each.in_lidar(lidar.counters.mounting) for each in lidar.counters.body.sectors]
            if sectors:
                text = described(sectors)
                if len(sectors) > self._logged.get(lidar.sensor_name, 0):
                    self._logged[lidar.sensor_name] = len(sectors)
                    lidar.log.warn(f'{text}; {advice(lidar.name, bool(lidar.label), lidar.input.mask, sectors)}')
                yield f'{lidar.label}{text}'
