# SPDX-License-Identifier: Apache-2.0
"""Assembly of the revolutions of a lidar whose driver sends each of them as several LaserScan messages."""
import array
import math
from typing import Any

import numpy as np

from ..core.scan import SECOND, in_nanoseconds

WIDEST = math.pi
"""Largest field of view [rad] of a message that may be a sector of a revolution."""
WIDEST_GAP = math.pi / 3.0
"""A wider gap between two sectors [rad] is one that the lidar does not see: the next revolution begins after it."""
LONGEST_GAP = SECOND
"""Messages that are farther apart than this [ns] belong to different revolutions."""
OVERLAP = 0.1
"""Fraction of the beams of a sector that may lie within the sector before it."""
SAME_STEP = 0.01
"""Largest relative difference of the steps between the beams of two sectors."""


class Revolution:
    """Assembles the messages of one lidar: sectors of one frame that follow each other become one message.

    A lidar sends sectors if one begins, in angle and in time, where the one before it ends. Messages of other lidars
    are passed on unchanged and without delay.

    Attributes
    ----------
    sectors : int
        Largest number of messages in a revolution so far; 0 if the messages are no sectors.
    """

    def __init__(self) -> None:
        self.sectors = 0
        self._last: Any = None
        self._parts: list[tuple[int, Any]] = []
        self._single = 0

    @property
    def note(self) -> str:
        """What is assembled, in a sentence; empty if the messages are no sectors."""
        return '' if not self.sectors else (
            f'a revolution comes in up to {self.sectors} messages, which are assembled: expected one; let the driver '
            'send whole revolutions (sick_scan_xd: topic scan_fullframe; Pilz: fragmented_scans false)')

    def add(self, message: Any) -> list[Any]:
        """Return the messages that are complete when this one has arrived: it, a whole revolution, or none.

        A `message` has the fields of a LaserScan or PointCloud2. The first one of a revolution becomes that of the
        revolution.
        """
        before, self._last = self._last, message
        if not _is_sector(message):
            return [*self.rest(), message]
        if not self._parts:
            place = _place(before, message)
            if not self.sectors and (place is None or abs(place - len(before.ranges)) > 1):
                return [message]
            return self._begin(message)
        first = self._parts[0][1]
        place, end = _place(first, message), self._end_of_parts()
        count = len(message.ranges)
        gap = math.inf if place is None or _place(before, message) is None else place - end
        if not -OVERLAP * count <= gap <= WIDEST_GAP / abs(first.angle_increment):
            return [*self.rest(), *self._begin(message)]
        self._parts.append((end + int(gap), message))
        self.sectors = max(self.sectors, len(self._parts))
        return self.rest() if self._is_whole() else []

    def _begin(self, message: Any) -> list[Any]:
        self.sectors = max(self.sectors, 1)
        self._parts = [(0, message)]
        return []

    def _end_of_parts(self) -> int:
        place, message = self._parts[-1]
        return place + len(message.ranges)

    def _is_whole(self) -> bool:
        """Whether the sectors cover the circle; narrower revolutions end where the next one begins."""
        return abs(self._parts[0][1].angle_increment) * (self._end_of_parts() + 1.5) > 2.0 * math.pi

    def rest(self) -> list[Any]:
        """Return the revolution of the sectors so far, if there are any; two of a single sector end the assembly."""
        if not self._parts:
            return []
        parts, size = self._parts, self._end_of_parts()
        self._parts = []
        self._single = self._single + 1 if len(parts) == 1 else 0
        if self._single > 1:
            self.sectors = self._single = 0
        return [_assembled(parts, size)] if len(parts) > 1 else [parts[0][1]]


def _is_sector(message: Any) -> bool:
    """Whether a message is a laser scan of at least two beams and a part of a circle."""
    step = getattr(message, 'angle_increment', 0.0)
    return bool(step) and math.isfinite(message.angle_min) and 0.0 < abs(step) * (len(message.ranges) - 1) <= WIDEST


def _place(first: Any, message: Any) -> int | None:
    """Return the number of steps from the first beam of one sector to that of another; None if none can follow.

    That is so if they differ in frame or step, or the other one was not measured soon afterwards.
    """
    if first is None or not _is_sector(first) or first.header.frame_id != message.header.frame_id:
        return None
    step = first.angle_increment
    passed = in_nanoseconds(message.header.stamp) - in_nanoseconds(first.header.stamp)
    if not 0 <= passed <= LONGEST_GAP or abs(message.angle_increment - step) > SAME_STEP * abs(step):
        return None
    turn = 2.0 * math.pi / abs(step)
    return round((((message.angle_min - first.angle_min) / step + 1.5) % turn) - 1.5)


def _assembled(parts: list[tuple[int, Any]], size: int) -> Any:
    """Return the first message with the ranges of all `parts`: number of the first beam, and message."""
    whole, (place, last) = parts[0][1], parts[-1]
    ranges = np.full(size, np.inf, dtype=np.float32)
    for begin, part in parts:
        ranges[begin:begin + len(part.ranges)] = part.ranges
    passed = in_nanoseconds(last.header.stamp) - in_nanoseconds(whole.header.stamp)
    if passed:
        whole.time_increment = passed / SECOND / place
    whole.angle_max = whole.angle_min + (size - 1) * whole.angle_increment
    whole.ranges = array.array('f', ranges.tobytes())
    whole.intensities = array.array('f')
    return whole
