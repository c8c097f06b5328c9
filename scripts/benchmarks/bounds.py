# SPDX-License-Identifier: Apache-2.0
"""What must hold of a figure."""
import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Bound:
    """The interval that a metric must lie in."""

    lowest: float = -math.inf
    highest: float = math.inf

    def holds(self, value):
        """Return whether the value is within the bound; False for `nan`, which was not measured."""
        return self.lowest <= value <= self.highest

    def __str__(self):
        if math.isinf(self.lowest):
            return f'at most {self.highest:g}'
        if math.isinf(self.highest):
            return f'at least {self.lowest:g}'
        return f'{self.lowest:g} to {self.highest:g}'


def at_least(limit) -> Bound:
    """Return a bound from below."""
    return Bound(lowest=limit)


def at_most(limit) -> Bound:
    """Return a bound from above."""
    return Bound(highest=limit)
