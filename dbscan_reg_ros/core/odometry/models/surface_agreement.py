# SPDX-License-Identifier: Apache-2.0
"""Whether surfaces look alike where they are seen again."""
from typing import NamedTuple


class SurfaceAgreement(NamedTuple):
    """Agreement of the normals in the last scans of a sensor with those in the references, along the weakest direction.

    Attributes
    ----------
    shared, seen : float
        Sums of `Registration.agreement` over the last scans.
    """

    shared: float = 0.0
    seen: float = 0.0

    def after(self, agreement: tuple[float, float]) -> 'SurfaceAgreement':
        """Return the sums with the `agreement` of one more scan."""
        shared, seen = agreement
        return SurfaceAgreement(_KEPT * self.shared + shared, _KEPT * self.seen + seen)

    @property
    def is_chance(self) -> bool:
        """Whether the normals agree no better than those of surfaces that look different in each scan."""
        return self.shared + _ASSUMED < _CHANCE * (self.seen + _ASSUMED)


_KEPT = 0.98
"""Weight of a scan relative to the next one."""
_ASSUMED = 3.0
"""Effective number of points that are assumed to agree before the first scan."""
_CHANCE = 0.2
"""Ratio of shared to seen information by chance. Independent normals agree a little, as the pose is that at which the
points fit best: in a hedge the ratio is 0.05 to 0.25. Among chair legs it is 0.25 to 0.8, elsewhere 0.6 to 1."""
