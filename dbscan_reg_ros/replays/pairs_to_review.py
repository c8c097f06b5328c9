# SPDX-License-Identifier: Apache-2.0
"""Pairs of scans of a replay to review: low-confidence scans, each with its reference scan."""
from dataclasses import dataclass

import numpy as np

from ..core.registration.records import Status

MOST_BAD = 100
LEAST_SURE = 12
"""Number of OK scans with the lowest overlap that are added to the pairs to review."""
BLOCK = 50
"""From each block of this many scans, at most one OK scan with low overlap is added."""
MOST_POINTS = 400


@dataclass(frozen=True, eq=False)
class PairToReview:
    """Pair to review: a scan and the reference that it was registered to."""

    number: int
    reference_number: int
    """Numbers of the scan and of its reference among the scans used, from 0."""
    status: Status
    overlap: float
    """Fraction of the scan's returns on the reference's surfaces, 0..1."""
    reason: str
    reference: np.ndarray
    current: np.ndarray
    """Returns of the reference, and of the scan at its estimated pose, in the reference's frame ``(P, 2)`` [m]."""
    reference_lines: np.ndarray
    current_lines: np.ndarray
    """Start and end of the matched segments, in the reference's frame ``(K, 2, 2)`` [m]."""


class PairsToReview:
    """Collect the first scan of every series of scans that are not ``OK``, and the OK scans with the lowest overlap."""

    def __init__(self):
        self._bad, self._least_sure, self._last = [], {}, Status.OK

    def add(self, update):
        """Process the `OdometryUpdate` of the next scan: store the scan if it needs a review."""
        changed, self._last = update.status is not self._last, update.status
        if update.registration is None or update.reference is None:
            return
        if update.status is not Status.OK:
            if changed and len(self._bad) < MOST_BAD:
                self._bad.append(_pair_to_review(update))
            return
        block = update.number // BLOCK
        if block not in self._least_sure or update.registration.overlap < self._least_sure[block].overlap:
            self._least_sure[block] = _pair_to_review(update)

    def found(self) -> list:
        """All `PairToReview` objects found, in the order of the scans."""
        least = sorted(self._least_sure.values(), key=lambda pair: pair.overlap)[:LEAST_SURE]
        return sorted([*self._bad, *least], key=lambda pair: pair.number)


def _pair_to_review(update):
    moved = update.reference_pose.inverse() @ update.pose
    registration, reference, current = update.registration, update.reference, update.features
    matched, matching = registration.matches.T
    return PairToReview(
        update.number, update.reference_number, update.status, registration.overlap, registration.reason,
        _thinned(reference.points), moved.apply(_thinned(current.points)),
        _lines(reference.segments, matched), moved.apply(_lines(current.segments, matching)))


def _lines(segments, chosen):
    return np.stack((segments.start[chosen], segments.end[chosen]), axis=1)


def _thinned(points):
    return points[::-(-len(points) // MOST_POINTS) or 1]
