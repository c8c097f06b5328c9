# SPDX-License-Identifier: Apache-2.0
"""Decisions of the gate, and the reasons for them."""
from enum import Enum
from typing import NamedTuple


class Decision(Enum):
    """Decision about a result."""

    ACCEPT = 'accept'
    """The result is believed; no further reference is tried."""
    TENTATIVE = 'tentative'
    """The result is believed unless a further reference gives one that is accepted."""
    REJECT = 'reject'
    """The result is not believed."""


class Reason(Enum):
    """Reason for a decision."""

    FAILED = 'the registration failed'
    TOO_FAST = 'faster than odometry.max_speed'
    TURNS_TOO_FAST = 'faster than odometry.max_turn_rate'
    POOR_SCORE = 'outside the gate, and the score is much lower than a moment ago'
    WITHIN_GATE = 'within the gate of a prediction'
    INCONCLUSIVE = 'within the gate, but a direction is degenerate or another result is tentative'
    UNRELIABLE = 'outside the gate, and not reliable enough to override the prediction'
    UNKNOWN_MOTION = 'outside the gate, but within that of an unknown motion'
    CONFIRMED = 'outside every gate, but the scan before was found at the same place'
    GUESS = 'not reliable, but more likely than a weak prediction'
    SCAN_BEFORE = 'registered to the scan before, without a prediction'
    REJOINED = 'found again in the map before the loss, which corrects the pose'
    UNCONFIRMED = 'outside every gate; the next scan may confirm it'


LIMITS = Reason.TOO_FAST, Reason.TURNS_TOO_FAST
"""Reasons for which the status of a scan is ``FAILED``."""


class Verdict(NamedTuple):
    """A decision of the gate and the reason for it."""

    decision: Decision
    reason: Reason

    @property
    def outlier(self) -> bool:
        """Whether the result is a reliable one outside the gates of the predictions: a jump if accepted."""
        return self.reason in (Reason.UNKNOWN_MOTION, Reason.CONFIRMED, Reason.UNCONFIRMED)
