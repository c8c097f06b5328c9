# SPDX-License-Identifier: Apache-2.0
"""The problem of a registration: both scans, parameters and prior; and the stages of its search."""
import dataclasses
from dataclasses import dataclass
from enum import Enum

from ..features.records import Features
from ..parameters.tree import Parameters
from .records import Prior


class SearchStage(Enum):
    """Which hypotheses a search considers; each stage considers more than the one before."""

    NEAR = 'near'
    """The hypotheses within the gate around the prior."""
    NORMAL = 'normal'
    """The clusters with the largest weights."""
    WIDE = 'wide'
    """`selection.wide_search_factor` times as many clusters, and the motions that match landmarks."""


@dataclass(frozen=True, eq=False)
class Problem:
    """Two scans to be registered, with parameters and prior.

    Attributes
    ----------
    reference, current : Features
        Features of the earlier and of the later scan.
    parameters : Parameters
    prior : Prior or None
    """

    reference: Features
    current: Features
    parameters: Parameters
    prior: Prior | None = None

    def widened(self) -> 'Problem':
        """Return the problem with the parameters of the wide stage."""
        return dataclasses.replace(self, parameters=self.parameters.widened)
