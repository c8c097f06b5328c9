# SPDX-License-Identifier: Apache-2.0
"""Lidars whose scans disagree with those of the first one: named on /diagnostics, and once in the log."""
import math
from collections.abc import Iterator, Sequence

from ...core.geometry.se2 import SE2
from ..interfaces.lidar import Lidar


class Disagreements:
    """Describes each lidar whose mounting or stamps are wrong relative to the first one."""

    def __init__(self) -> None:
        self._logged: set[str] = set()

    @staticmethod
    def clocks(lidars: Sequence[Lidar]) -> list[str]:
        """Return and log a sentence for each lidar whose clock differs from that of the first one."""
        texts = []
        for lidar in lidars:
            apart = lidar.counters.compared.apart if lidar.counters.compared else 0.0
            if apart:
                side = 'ahead of' if apart > 0.0 else 'behind'
                text = f'its clock is {abs(apart):.1f} s {side} that of the first lidar'
                lidar.log.warn(f'{text}: it is not used; synchronise the clocks (NTP, PTP), or let the driver stamp '
                               'the scans when it receives them')
                texts.append(f'{lidar.label}{text}')
        return texts

    def found(self, lidars: Sequence[Lidar]) -> Iterator[str]:
        """Yield a sentence for each lidar that disagrees; log it when it is new, with what to do."""
        for lidar in lidars:
            compared = lidar.counters.compared
            if compared is None or compared.error is None:
                self._logged.discard(lidar.topic)
                continue
            text = f'disagrees with the first lidar: {compared.error}'
            if lidar.topic not in self._logged:
                self._logged.add(lidar.topic)
                lidar.log.warn(f'{text}; it is not used until it agrees; {_remedy(lidar)}')
            yield f'{lidar.label}{text}'


def _remedy(lidar: Lidar) -> str:
    """Return which transform and which parameter to set, and to which value, if the first lidar is right."""
    compared = lidar.counters.compared
    assert compared is not None and compared.estimate is not None and compared.error is not None
    remedies, estimate = [], compared.estimate
    if compared.error.distance or compared.error.rotation:
        # The scans are rotated by the yaw of the mounting, so the estimate contains its error only.
        pose = estimate.pose @ SE2(theta=lidar.counters.mounting.pose.theta)
        remedies.append(f'set its transform to x {pose.x:.3f} m, y {pose.y:.3f} m, yaw {pose.theta:.4f} rad '
                        f'({math.degrees(pose.theta):.2f} deg)')
    if compared.error.time_offset:
        remedies.append(f'set input.time_offset of it to {lidar.input.time_offset[0] + estimate.time_offset:.3f}')
    return f'if the first one is right, {" and ".join(remedies)}'
