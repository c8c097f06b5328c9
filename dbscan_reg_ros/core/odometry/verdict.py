# SPDX-License-Identifier: Apache-2.0
"""Decisions of the gate, and the reasons for them."""
from enum import Enum
from typing import NamedTuple


class Decision(Enum):
    """Decision of the gate about the result of a registration."""

    ACCEPT = 'accept'
    """The result is used, and no further key frame is tried; after a weak prior, if it is not ``OK``, the previous scan
    is."""
    TENTATIVE = 'tentative'
    """The result is used unless another reference gives an accepted result."""
    REJECT = 'reject'
    """The result is not used. Only the pose of a `Reason.GUESS` is, as that of a scan that was not found."""


class Reason(Enum):
    """Reason for a decision of the gate."""

    FAILED = 'the registration failed'
    TOO_FAST = 'faster than odometry.max_speed'
    TURNS_TOO_FAST = 'faster than odometry.max_turn_rate'
    POOR_SCORE = 'outside the gate, and the score is much lower than that of the last registered scan'
    WITHIN_GATE = 'within the gate of a prediction'
    INCONCLUSIVE = 'within the gate, but a direction is degenerate or another result is tentative'
    UNRELIABLE = 'outside the gate, and not reliable enough to override the prediction'
    UNKNOWN_MOTION = 'outside the gate, but within the gate for an unknown motion'
    GUESS = 'the result is not reliable, but more likely than a weak prediction'
    SCAN_BEFORE = 'registered to the previous scan, without a prediction'
    AFTER_GAP = 'the pose is unknown since a gap of the scans; expected a place in the map before it, or set_pose'
    REJOINED = 'found again in the map before the loss, which corrects the pose'
    OUTSIDE = 'outside every gate'


LIMITS = Reason.TOO_FAST, Reason.TURNS_TOO_FAST
"""Reasons for which the status of a scan is ``FAILED``."""


class Verdict(NamedTuple):
    """A decision of the gate and the reason for it."""

    decision: Decision
    reason: Reason
