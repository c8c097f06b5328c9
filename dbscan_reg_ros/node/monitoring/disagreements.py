# SPDX-License-Identifier: Apache-2.0
"""Lidars whose scans disagree with those of the first one: named on /diagnostics, and once in the log."""
import math
from collections.abc import Iterator, Sequence

from ...core.geometry.se2 import SE2
from ...core.odometry.calibration.compared_lidar import ComparedLidar
from ...core.odometry.calibration.majority import UNFIT, described, disagreeing
from ...core.odometry.calibration.wheels import Wrong
from ..interfaces.lidar import Lidar


class Disagreements:
    """Describes each lidar with a wrong mounting or wrong stamps: relative to the first one, or the first itself."""

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
        found = disagreeing(lidars[0].counters.mounting.aligned_pose,
                            [lidar.counters.compared for lidar in lidars[1:]])
        for lidar, compared in zip(lidars, found, strict=True):
            is_first = lidar is lidars[0]
            if compared is not None:
                text = described(compared, is_first)
                remedy = f'; {_use(compared, is_first)}{_remedy(lidar, compared)}'
            elif lidar.counters.compared and lidar.counters.compared.unfit:
                text, remedy = UNFIT, ''
            else:
                self._logged.discard(lidar.sensor_name)
                continue
            if lidar.sensor_name not in self._logged:
                self._logged.add(lidar.sensor_name)
                lidar.log.warn(f'{text}{remedy}')
            yield f'{lidar.label}{text}'


def _use(compared: ComparedLidar, is_first: bool) -> str:
    """Return which lidars are used if the first one is wrong, else whether the compared one is."""
    if is_first:
        return 'the others are not used until they agree with it; '
    use = 'its estimated mounting is used' if compared.used != compared.given else 'it is not used until it agrees'
    return f'{use}; ' if compared.wrong is Wrong.FURTHER else f'{use}; if the first one is right, '


def _remedy(lidar: Lidar, compared: ComparedLidar) -> str:
    """Return which transform and which parameter of a `lidar` to set, and to which value."""
    assert compared.estimate is not None and compared.error is not None
    remedies, estimate = [], compared.estimate
    if compared.error.distance or compared.error.rotation:
        # The scans are rotated by the yaw of the mounting, so the estimate contains its error only.
        pose = estimate.pose @ SE2(theta=lidar.counters.mounting.pose.theta)
        remedies.append(f'set its transform to x {pose.x:.3f} m, y {pose.y:.3f} m, yaw {pose.theta:.4f} rad '
                        f'({math.degrees(pose.theta):.2f} deg)')
    if compared.error.time_offset:
        remedies.append(f'set input.time_offset of it to {lidar.input.time_offset[0] + estimate.time_offset:.3f}')
    return ' and '.join(remedies)
