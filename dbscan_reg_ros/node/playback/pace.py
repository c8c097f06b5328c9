# SPDX-License-Identifier: Apache-2.0
"""Pace of a playback."""
import time


class Pace:
    """Playback at a constant rate: the time of the recording runs `rate` times as fast as the steady clock."""

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self._start: tuple[int, float] | None = None

    def remaining(self, due: int) -> float:
        """Return the time [s] until the recording time reaches `due` [ns]; 0 at the first call."""
        now = time.monotonic()
        self._start = self._start or (due, now)
        return self._start[1] + (due - self._start[0]) * 1e-9 / self.rate - now
