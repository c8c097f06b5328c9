# SPDX-License-Identifier: Apache-2.0
"""Returns of a scan that the parameters admit, with their noise."""
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import ScanError
from ..geometry.array_types import BoolArray, FloatArray
from ..geometry.se2 import as_complex
from ..parameters.features import ScanParameters
from ..scan import Scan
from .noise import estimate_noise, estimate_noise_ratio


@dataclass(frozen=True, eq=False)
class Returns:
    """The admitted returns of a scan.

    Attributes
    ----------
    scan : Scan
    points : (N, 2) float [m]
        Points in the frame of the sensor, one for each beam; not finite without an admitted return.
    limits : ScanParameters
    """

    scan: Scan
    points: FloatArray
    limits: ScanParameters

    @cached_property
    def valid(self) -> BoolArray:
        """``(N,)`` bool: beams with an admitted return."""
        return np.isfinite(self.points[:, 0])

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a range [m]."""
        return estimate_noise(self._ranges, self.limits)

    @cached_property
    def noise_ratio(self) -> float:
        """Standard deviation of a range as a fraction of the range; 0 if far ranges are no noisier than near ones."""
        beams = self.valid.nonzero()[0]
        return estimate_noise_ratio(as_complex(self.points)[beams], self._ranges, beams, self.limits)

    @cached_property
    def _ranges(self) -> FloatArray:
        """Ranges [m] of the beams with an admitted return."""
        return self.scan.ranges[self.valid].astype(float)


def admitted_returns(scan: Scan, limits: ScanParameters) -> Returns:
    """Select the returns of a scan between `range_min` and `range_max`.

    Parameters
    ----------
    scan : Scan
    limits : ScanParameters

    Raises
    ------
    ScanError
        When fewer than `min_returns` beams have a return.
    """
    ranges, points = scan.ranges, scan.points
    if limits.range_min > 0.0:
        points = np.where((ranges >= limits.range_min)[:, None], points, np.nan)
    if limits.range_max > 0.0:
        points = np.where((ranges <= limits.range_max)[:, None], points, np.nan)
    returns = Returns(scan, points, limits)
    count = np.count_nonzero(returns.valid)
    if count < limits.min_returns:
        raise ScanError(f'{count} of {scan.geometry.size} beams have a return; advanced.scan.min_returns asks for '
                        f'{limits.min_returns}')
    return returns
