# SPDX-License-Identifier: Apache-2.0
"""Mask and time offset of the scans of a lidar, the same in the node and in replays."""
import math

import numpy as np
from numpy.typing import NDArray

from ..core.geometry.mounting import Mounting
from ..core.scan import SECOND, Scan
from ..core.scan_geometry import ScanGeometry
from .parameter_groups import InputParameters

BEARING_TOLERANCE = 1e-6
"""Tolerance [rad] for rounded bearings at the border of a masked sector."""


class Mask:
    """Removes the returns of one lidar in the sectors of ``input.mask``.

    Attributes
    ----------
    fault : str
        Sentence on sectors in which the last scan had no beam; empty if there are none.
    """

    def __init__(self) -> None:
        self.fault = ''
        self._geometry: ScanGeometry | None = None
        self._key: object = None
        self._masked: NDArray[np.bool_] = np.zeros(0, dtype=bool)

    def apply(self, scan: Scan, mounting: Mounting, parameters: InputParameters) -> Scan:
        """Return a scan without its returns in the sectors of ``input.mask`` that are nearer than ``input.mask_range``.

        The bearings of the scan are those of an upright lidar with a yaw of 0, as `Scan.from_message` returns it; the
        sectors are in the frame of the lidar, hence its `mounting`. It is ``Mounting()`` if the bearings are in that
        frame, too.
        """
        limit, masked = parameters.mask_range, self._in_sectors(scan, mounting, parameters)
        if limit > 0.0:
            masked = masked & (scan.ranges < limit)
        if not masked.any():
            return scan
        return Scan(scan.stamp, np.where(masked, np.float32(np.nan), scan.ranges), scan.geometry, scan.time_increment,
                    scan.frame_id)

    def _in_sectors(self, scan: Scan, mounting: Mounting, parameters: InputParameters) -> NDArray[np.bool_]:
        """Return which beams ``(N,)`` lie in a sector; cached until parameters, mounting or geometry change."""
        key = parameters.mask, mounting
        if self._key != key or self._geometry is not scan.geometry:
            sectors = np.reshape(parameters.mask, (-1, 2))
            sectors = sectors[sectors[:, 0] != sectors[:, 1]]
            bearings = scan.geometry.bearings - mounting.pose.theta
            self._key, self._geometry = key, scan.geometry
            bearings = -bearings if mounting.upside_down else bearings
            self._masked = within(bearings, sectors)
            self.fault = _fault(bearings, sectors)
        return self._masked


def _fault(bearings: NDArray[np.float64], sectors: NDArray[np.float64]) -> str:
    """Return a sentence on the `sectors` without any of the `bearings`; empty if each has one."""
    empty = [sector for sector in sectors if not within(bearings, sector[None]).any()]
    if not empty:
        return ''
    names = ', '.join(f'{first:g} to {last:g} rad' for first, last in empty)
    return (f'input.mask has {names}, where the lidar has no beam: it sees {bearings.min():.4g} to '
            f'{bearings.max():.4g} rad; expected bearings in the frame of the lidar, counter-clockwise, in radians')


def corrected_stamp(stamp: int, offset: float) -> int:
    """Return a `stamp` [ns] plus ``input.time_offset`` [s]; 0, which means no stamp, stays 0."""
    return stamp + round(offset * SECOND) if stamp else stamp


def within(bearings: NDArray[np.float64], sectors: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which `bearings` ``(N,)`` [rad] lie in at least one of the `sectors` ``(M, 2)``, ``(N,)`` bool.

    A sector is its first and last bearing, counter-clockwise [rad].
    """
    full = 2.0 * math.pi
    widths = np.remainder(sectors[:, 1] - sectors[:, 0], full)
    widths[widths == 0.0] = full
    offsets = np.remainder(bearings[:, None] - sectors[:, 0], full)
    return np.asarray((offsets <= widths + BEARING_TOLERANCE).any(axis=1))
