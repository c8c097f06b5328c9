# SPDX-License-Identifier: Apache-2.0
"""Times at which messages are played; they never go back, even if stamps do."""

RESTART = 10_000_000_000
"""A step back of the stamps by this or more [ns] is no jitter: the recording was looped, or its clock was set."""


class Schedule:
    """Makes the stamps of a recording monotone, one at a time, without changing the order of the messages.

    A stamp that goes back is given the last time; after a step back of 10 s or more, time continues from the last one.
    """

    def __init__(self):
        self._last = None
        self._offset = 0

    def time(self, stamp) -> int:
        """Return the time [ns] at which a message with this `stamp` [ns] is due; times never decrease."""
        if self._last is not None and stamp + self._offset <= self._last - RESTART:
            self._offset = self._last - stamp
        time = stamp + self._offset
        self._last = time if self._last is None else max(time, self._last)
        return self._last


class Timeline:
    """Times at which messages are due: scans at their stamps, others as long after the last scan as recorded."""

    def __init__(self):
        self._schedule = Schedule()
        self._due = self._recorded = None

    def due(self, played):
        """Return the time [ns] at which the next `Played` is due; None (at once) before the first scan."""
        if played.channel is None:
            self._due, self._recorded = self._schedule.time(played.content.stamp), played.time
        elif self._recorded is not None:
            return self._due + max(0, played.time - self._recorded)
        return self._due
