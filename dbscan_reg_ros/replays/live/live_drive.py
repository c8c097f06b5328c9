# SPDX-License-Identifier: Apache-2.0
"""Events of a drive of a running node for the browsers that show the drive, in bounded memory."""
from __future__ import annotations

import json
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..page.encoding import packed, picture, rounded
from ..page.scan_history import LARGEST, RESOLUTION
from .live_map import LiveMap

if TYPE_CHECKING:
    from ...node.watching.listener import WatchedScan

MOST_EVENTS = 3000
MOST_BYTES = 8_000_000
"""Largest number and total size of the events that are kept for browsers that connect later."""
MOST_RETURNS = 720
"""Largest number of returns shown of a scan; of a scan with more returns every n-th is shown."""
SHARE = 20
"""Drawing the map takes at most the fraction one over this of the computing time."""
PERIOD = 1.0
"""The map is drawn at most once in this time [s]."""


class LiveDrive:
    """Events of a drive, numbered from 1; any number of threads may wait for them.

    Attributes
    ----------
    map : LiveMap
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._browsers = 0
        self._closed = False
        self._next = 1
        self._drive = 0
        self._restart('')

    def _restart(self, source: str) -> None:
        self.map = LiveMap()
        self._source = source
        self._drive += 1
        self._events: deque[tuple[int, bytes]] = deque()
        self._bytes = 0
        self._drawn, self._drawn_version = b'', 0
        self._draw_after = 0.0
        self._report = 3, 'no report on /diagnostics yet'

    @property
    def browsers(self) -> int:
        """Number of browsers that are connected."""
        return self._browsers

    def restart(self, source: str) -> None:
        """Begin a new drive of the node `source`; browsers remove the previous drive."""
        with self._changed:
            self._restart(source)
            self._changed.notify_all()

    def report(self, level: int, message: str) -> None:
        """Store level (0 to 3) and message of the latest diagnostics, to be shown with the scans added later."""
        self._report = level, message

    def add(self, scan: WatchedScan) -> None:
        """Add the next scan to the map and to the events of the drive."""
        points = scan.points[::-(-len(scan.points) // MOST_RETURNS) or 1]
        event = _event('scan', self._fields(scan, points))
        with self._changed:
            self.map.add(scan.pose.apply(points))
            self._append(event)
            self._changed.notify_all()

    def _append(self, event: bytes) -> None:
        self._events.append((self._next, event))
        self._next += 1
        self._bytes += len(event)
        while len(self._events) > MOST_EVENTS or self._bytes > MOST_BYTES:
            self._bytes -= len(self._events.popleft()[1])

    def _fields(self, scan: WatchedScan, points) -> dict:
        values, vectors = np.linalg.eigh(scan.covariance[:2, :2])
        short, long = np.sqrt(np.maximum(values, 0.0))
        units = np.rint(points / RESOLUTION)
        units = units[(np.abs(units) <= LARGEST).all(axis=1)]
        level, message = self._report
        return {'time': scan.stamp * 1e-9, 'pose': rounded(scan.pose.as_array(), 4),
                'sigma': rounded((long, short, np.arctan2(vectors[1, 1], vectors[0, 1]),
                                  np.sqrt(max(scan.covariance[2, 2], 0.0))), 6),
                'status': level, 'reason': message, 'speed': round(float(scan.speed), 3),
                'points': packed(units, '<i2')}

    def draw_map(self) -> None:
        """Draw the map if it has changed and enough time has passed."""
        now = time.monotonic()
        if self.map.version == self._drawn_version or now < self._draw_after:
            return
        with self._changed:
            drawn = self.map
            density, version = drawn.density(), drawn.version
        event = _event('map', {'image': picture(density.ink), 'extent': rounded(density.extent)})
        with self._changed:
            self._draw_after = now + max(PERIOD, SHARE * (time.monotonic() - now))
            if self.map is drawn:
                self._drawn, self._drawn_version = event, version
                self._changed.notify_all()

    def close(self) -> None:
        """End all `events`."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def __enter__(self) -> LiveDrive:
        """Add one to the number of connected browsers."""
        with self._changed:
            self._browsers += 1
        return self

    def __exit__(self, *_: object) -> None:
        """Subtract one from the number of connected browsers."""
        with self._changed:
            self._browsers -= 1

    def events(self, patience: float):
        """Yield the events to send to a browser, beginning with the stored events of the drive.

        A browser that falls behind the stored events restarts from the first of them. If no event occurs within
        `patience` [s], a comment is sent, which detects a disconnected browser.
        """
        sent = _Sent()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._is_new_to(sent), patience)
                if self._closed:
                    return
                part = self._new_to(sent)
            yield part or b': nothing new\n\n'

    def _is_new_to(self, sent: _Sent) -> bool:
        """Whether there are events or a map that were not yet sent to a browser."""
        return self._drive != sent.drive or self._next > sent.after + 1 or self._drawn is not sent.drawn

    def _new_to(self, sent: _Sent) -> bytes:
        """Return the events that were not yet sent to a browser, and mark them as sent."""
        oldest = self._events[0][0] if self._events else self._next
        parts = []
        if self._drive != sent.drive or sent.after + 1 < oldest:
            parts.append(_event('start', {'source': self._source}))
            sent.drive, sent.after, sent.drawn = self._drive, oldest - 1, None
        newer = [event for _, event in self._events][sent.after + 1 - oldest:]
        parts += newer
        sent.after += len(newer)
        if self._drawn is not sent.drawn:
            sent.drawn = self._drawn
            parts.append(self._drawn)
        return b''.join(parts)


@dataclass
class _Sent:
    """State of a browser: the numbers of the drive, of the last event and of the map that were sent to it."""

    drive: int = 0
    after: int = -1
    drawn: bytes | None = None


def _event(name: str, fields: dict) -> bytes:
    """Return a server-sent event."""
    return f'event: {name}\ndata: {json.dumps(fields, separators=(",", ":"))}\n\n'.encode()
