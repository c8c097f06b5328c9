# SPDX-License-Identifier: Apache-2.0
"""Lidars that disagree with others, or see the robot itself: named on /diagnostics, and once in the log."""
import math
from collections.abc import Iterator, Sequence

from ...core.geometry.se2 import SE2
from ...core.odometry.calibration.odd_one import UNFIT, Named, named
from ...core.odometry.calibration.relative_pose import RelativePose
from ...robot.own_body import advice, described
from ..interfaces.lidar import Lidar


class Disagreements:
    """Describes each lidar that disagrees with others, and what the scans show about each further one."""

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
        compared = [lidar.counters.compared for lidar in lidars[1:]]
        odd = named(lidars[0].counters.mounting.aligned_pose, compared)
        for lidar, each in zip(lidars, odd, strict=True):
            if each is not None:
                text, remedy = str(each), f'; {_use(lidar)}{_remedy(lidar, each)}'
            elif lidar.counters.compared and lidar.counters.compared.unfit:
                text, remedy = UNFIT, ''
            else:
                self._logged.discard(lidar.sensor_name)
                continue
            if lidar.sensor_name not in self._logged:
                self._logged.add(lidar.sensor_name)
                lidar.log.warn(f'{text}{remedy}')
            yield f'{lidar.label}{text}'

    @staticmethod
    def estimates(lidars: Sequence[Lidar]) -> Iterator[tuple[str, str]]:
        """Yield mounting and time offset of each further lidar by the scans, with standard deviations."""
        for lidar in lidars:
            compared = lidar.counters.compared
            if compared and compared.known:
                x, y, yaw, offset = compared.estimate.sigmas
                pose, time_offset = _by_scans(lidar, compared.estimate)
                yield (f'{lidar.label}mounting and time offset by the scans',
                       f'x {pose.x:.3f} +- {x:.3f} m, y {pose.y:.3f} +- {y:.3f} m, yaw {math.degrees(pose.theta):.2f} '
                       f'+- {math.degrees(yaw):.2f} deg, {time_offset:.3f} +- {offset:.3f} s')


def _use(lidar: Lidar) -> str:
    """Return which lidars are not used."""
    return 'it is not used until it agrees; ' if lidar.rank else 'the others are not used until they agree with it; '


def _by_scans(lidar: Lidar, estimate: RelativePose) -> tuple[SE2, float]:
    """Return an estimated mounting on the base, and the value for ``input.time_offset`` [s]."""
    # The scans are rotated by the yaw of the mounting, so the estimate contains its error only.
    pose = estimate.pose @ SE2(theta=lidar.counters.mounting.pose.theta)
    return pose, lidar.input.time_offset[0] + estimate.time_offset


def _remedy(lidar: Lidar, odd: Named) -> str:
    """Return which transform and which parameter of a `lidar` to set, and to which value."""
    pose, time_offset = _by_scans(lidar, odd.estimate)
    remedies = []
    if odd.error.distance or odd.error.rotation:
        remedies.append(f'set its transform to x {pose.x:.3f} m, y {pose.y:.3f} m, yaw {pose.theta:.4f} rad '
                        f'({math.degrees(pose.theta):.2f} deg)')
    if odd.error.time_offset:
        remedies.append(f'set input.time_offset of it to {time_offset:.3f}')
    return ' and '.join(remedies) or 'drive curves and with different speeds, which shows the values to set'


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
