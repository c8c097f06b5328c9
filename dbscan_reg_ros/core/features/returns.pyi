# SPDX-License-Identifier: Apache-2.0
"""Returns of a scan that the parameters admit, with their noise."""
from collections.abc import Sequence

from ..geometry.array_types import FloatArray
from ..parameters.features import ScanParameters
from ..scan import Scan

class Returns:
    scan: Scan
    noise: float

    def __init__(
        self, scan: Scan, limits: ScanParameters, twist: Sequence[float] | FloatArray | None = None
    ) -> None: ...
    @property
    def points(self) -> FloatArray: ...
    @property
    def noise_ratio(self) -> float: ...

def deskew(scan: Scan, twist: Sequence[float] | FloatArray) -> Scan: ...
