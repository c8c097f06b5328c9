# SPDX-License-Identifier: Apache-2.0
"""Detection of the range that a driver sends in place of a missing return."""
import numpy.typing as npt

from .scan import Scan

class NoReturn:
    @property
    def known(self) -> float | None: ...
    def add(self, ranges: npt.ArrayLike, range_max: float, angle_increment: float) -> list[float]: ...
    def removed_from(self, scan: Scan) -> Scan: ...
