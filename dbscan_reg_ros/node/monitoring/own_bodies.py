# SPDX-License-Identifier: Apache-2.0
"""Lidars that see the robot itself: named on /diagnostics, and once in the log with the mask to set."""
import itertools
import math
from collections.abc import Iterator, Sequence

from ...robot.own_body import BodySector
from ...robot.parameter_groups import SECTORS
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
                text = f'sees the robot itself: {", ".join(map(_described, sectors))}'
                if len(sectors) > self._logged.get(lidar.topic, 0):
                    self._logged[lidar.topic] = len(sectors)
                    lidar.log.warn(f'{text}; set input.mask of it to {_mask(lidar.input.mask, sectors)}')
                yield f'{lidar.label}{text}'


def _described(sector: BodySector) -> str:
    first, last = (math.degrees(bearing) for bearing in (sector.first, sector.last))
    return f'from {first:.0f} to {last:.0f} deg at {sector.range:.2f} m'


def _mask(given: Sequence[float], sectors: Sequence[BodySector]) -> list[float]:
    """Return the value of the mask with the sectors `given` and found, as many as it can have."""
    pairs = [(first, last) for first, last in zip(given[::2], given[1::2], strict=True) if first != last]
    pairs += [(round(each.first, 3), round(each.last, 3)) for each in sectors]
    values = list(itertools.chain(*pairs))[:2 * SECTORS]
    return values + [0.0] * (2 * SECTORS - len(values))
